"""Cameras as they are made: what can be wrong with one, draws of it, and what matters most.

The wave of each draw is the designed one with the sum of its changes, to first order (`prescription.errors`),
or that of rays through the lens as it is made. The image as a whole may move: where points land is not
counted, but how the colours land next to each other is. Edges of the pupil stay where they are, and a change
is that of light in focus, from any distance.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache

import torch
from torch import Tensor

from ..errors import InputError
from ..recipe.fabrication import Fabrication
from ..recipe.tolerances import Tolerances
from .camera import Camera, focal_length
from .grid import PupilGrid
from .height import surface
from .lenses.base import ChangedLens, Field, Longer
from .lenses.prescription import PrescriptionLens
from .masks import PhaseMask
from .prescription.errors import (
    CENTRE,
    FOCUS,
    INDEX,
    RADIUS,
    SPACING,
    TILT,
    Change,
    Errors,
    Exact,
    Slopes,
    elements_of,
    exact,
    first_order,
    fitted_slopes,
    planes,
    slopes,
)
from .prescription.outline import quantities_at
from .prescription.surfaces import Stack

MM, ARCMIN = 1e-3, math.radians(1 / 60)
POWER, MASK = "power", "mask height"
QUARTERS = (0.0, 0.5 * math.pi, math.pi, 1.5 * math.pi)
"""Directions of places in the field that the sensor is focused for: all round, so that a tilt is no focus."""
MASK_SAMPLES = 258
"""Across the pupil, for what a mask's height changes."""


@dataclass(frozen=True)
class Part:
    """One thing that can be wrong. number: of the element or surface; where: its surfaces, in words;
    deviation: standard deviation in mm, radians, or relative."""

    kind: str
    number: int
    where: str
    deviation: float

    @property
    def name(self) -> str:
        """In figures."""
        return ".".join(each for each in (self.kind.replace(" ", "_"), self.where) if each)

    @property
    def directed(self) -> bool:
        """Whether it has two directions."""
        return self.kind in (CENTRE, TILT)


def parts_of(camera: Camera, tolerances: Tolerances) -> list[Part]:
    """What can be wrong with a camera. Raises InputError for a lens that is known by its PSFs alone, and for
    tolerances of a surface that is none."""
    lens = camera.lens
    found: list[Part] = []
    if lens.measured:
        raise InputError("a lens by measured PSFs has no tolerances: nothing is known of its surfaces")
    if isinstance(lens, PrescriptionLens):
        found = _of_surfaces(lens.held().lens, tolerances)
    else:
        if tolerances.elements:
            raise InputError(
                f"tolerances.elements: a lens of kind {lens.kind} has no surfaces; leave them out"
            )
        found.append(Part(POWER, 0, "", tolerances.power_percent / 100))
    found.append(Part(FOCUS, 0, "", tolerances.focus_um * 1e-3))
    if isinstance(camera.mask, PhaseMask) or camera.height_map is not None:
        found.append(Part(MASK, 0, "", tolerances.mask_height_percent / 100))
    return [part for part in found if part.deviation]


def _of_surfaces(stack: Stack, tolerances: Tolerances) -> list[Part]:
    elements = elements_of(stack)
    owner = {surface: number for number, some in enumerate(elements) for surface in some}
    own: dict[int, dict[str, float]] = {}
    for each in tolerances.elements:
        if each.surface not in owner:
            raise InputError(
                f"tolerances.elements: surface {each.surface} is part of no element; there are"
                f" {', '.join(map(str, owner))}"
            )
        own[owner[each.surface]] = each.model_dump(exclude={"surface"}, exclude_none=True)

    def value(element: int | None, key: str) -> float:
        return own.get(-1 if element is None else element, {}).get(key, getattr(tolerances, key))

    found = []
    for number, some in enumerate(elements):
        where = f"{some[0]}-{some[-1]}"
        if any(_curved(stack, surface_) for surface_ in some):
            found.append(Part(CENTRE, number, where, value(number, "decentre_um") * 1e-3))
        found.append(Part(TILT, number, where, value(number, "tilt_arcmin") * ARCMIN))
    for number, medium in enumerate(stack.media):
        element, where = owner.get(number), str(number)
        if number + 1 < len(stack) and number >= min(owner, default=0):
            found.append(Part(SPACING, number, where, value(element, "spacing_um") * 1e-3))
        if medium is not None:
            found.append(Part(INDEX, number, where, value(element, "index")))
        if float(stack.curvature[number]):
            found.append(Part(RADIUS, number, where, value(element, "radius_percent") / 100))
    return found


def _curved(stack: Stack, surface_: int) -> bool:
    return any(bool(each[surface_].any()) for each in (stack.curvature, stack.even, stack.odd))


@dataclass(frozen=True)
class Draw:
    """A camera as it is made. errors: of its lens, in mm, radians, or relative, with the place of the sensor;
    power, mask: how much longer the focal length and higher the relief is, relative."""

    errors: Errors
    power: float = 0.0
    mask: float = 0.0

    @property
    def said(self) -> str:
        return json.dumps(asdict(self), sort_keys=True)


class Series:
    """Cameras made by one recipe. fields: tangents from the axis that they are focused for, and at which
    errors are weighed, all round. parts: what can be wrong. Raises InputError as `parts_of`, and where no
    light gets through."""

    def __init__(self, camera: Camera, fields: Sequence[float]) -> None:
        self.camera, self.fields = camera, tuple(fields)
        self.tolerances = camera.recipe.tolerances or Tolerances()
        self.parts = parts_of(camera, self.tolerances)
        self._axes = [(part, axis) for part in self.parts for axis in range(1 + part.directed)]
        self._slopes = cache(self._slopes_at)
        unit = torch.eye(len(self._axes), dtype=torch.float64)
        each = [*(self._draw(row, 0.0).errors for row in unit), Errors(focus=1.0)]
        traced = isinstance(camera.lens, PrescriptionLens)
        self._alike = self._by_rays(each) if traced else self._by_parabolas()

    def draw(self, seed: int, number: int) -> Draw:
        """One of the series; each number is a camera of its own, whatever others there are."""
        generator = torch.Generator().manual_seed((seed * 1_000_003 + number) % 2**63)
        normal = torch.randn(len(self._axes), generator=generator, dtype=torch.float64)
        return self._draw(normal, self._refocused(normal) if self.tolerances.refocused else 0.0)

    def _draw(self, normal: Tensor, focus: float) -> Draw:
        """Of standard deviations [axis], with the sensor moved by `focus` [mm] before its own error."""
        found: dict[str, dict[int, float]] = {}
        vectors: dict[str, dict[int, tuple[float, float]]] = {CENTRE: {}, TILT: {}}
        for (part, axis), value in zip(self._axes, (normal.tolist()), strict=True):
            if part.directed:
                known = vectors[part.kind].get(part.number, (0.0, 0.0))
                more = (value * part.deviation, 0.0) if axis == 0 else (0.0, value * part.deviation)
                vectors[part.kind][part.number] = (known[0] + more[0], known[1] + more[1])
            else:
                found.setdefault(part.kind, {})[part.number] = value * part.deviation
        alone = {kind: found.get(kind, {}).get(0, 0.0) for kind in (FOCUS, POWER, MASK)}
        scalars = (found.get(kind, {}) for kind in (SPACING, INDEX, RADIUS))
        errors = Errors(vectors[CENTRE], vectors[TILT], *scalars, focus=focus + alone[FOCUS])
        return Draw(errors, alone[POWER], max(alone[MASK], -0.99))

    def _refocused(self, normal: Tensor) -> float:
        """Where [mm] the sensor is nearest the designed wave: what is wrong with it is not known then."""
        before = torch.tensor([part.kind != FOCUS for part, _ in self._axes])
        along, own = self._alike[-1, :-1] @ normal.where(before, 0.0), self._alike[-1, -1]
        return -float(along / own)

    def rms(self, part: Part) -> float:
        """Waves, root mean square over pupil and field, that one standard deviation of a part makes, in both
        of its directions together, after the camera was focused again."""
        if part.kind == MASK:
            return part.deviation * self._mask_waves()
        again = self.tolerances.refocused and part.kind != FOCUS
        total = 0.0
        for k in [k for k, (each, _) in enumerate(self._axes) if each == part]:
            shared = self._alike[k, -1] ** 2 / self._alike[-1, -1] if again else 0.0
            total += max(0.0, float(self._alike[k, k] - shared))
        return math.sqrt(total)

    def made(self, draw: Draw, *, exactly: bool = False) -> Camera:
        """A camera of the series; exactly: by rays through its own lens, not to first order, and focused by
        these."""
        camera, lens = self.camera, self.camera.lens
        if not isinstance(lens, PrescriptionLens):
            longer = self._bowl(draw)
        else:
            longer = self._traced(lens, self._again(draw) if exactly else draw, exactly)
        said = f"{draw.said} exactly" if exactly else draw.said
        made = replace(camera, lens=ChangedLens.of(lens, said, longer))
        if all(part.kind != MASK for part in self.parts):
            return made
        fabrication = camera.recipe.fabrication or Fabrication()
        fabrication = fabrication.model_copy(
            update={"height_scale": fabrication.height_scale * (1 + draw.mask)}
        )
        return replace(made, recipe=camera.recipe.model_copy(update={"fabrication": fabrication}))

    @property
    def wavelength(self) -> float:
        """Of the focus and of all that is in waves, m."""
        lens = self.camera.lens
        nm = (
            lens.traced_at_nm
            if isinstance(lens, PrescriptionLens)
            else self.camera.recipe.focus.wavelength_nm
        )
        return nm * 1e-9

    def difference(self, draw: Draw, field: Field) -> tuple[float, float]:
        """Root mean square over the pupil, in waves, of the change of the wave from a place in the field: of
        the exact one, and of what the first order leaves of it."""
        true, first, _ = self._on_grid(self._again(draw), draw, field)
        return float(true.std()), float((true - first).std())

    def _again(self, draw: Draw) -> Draw:
        """With the sensor where the exact wave is as near the designed one as the first order takes it to
        be."""
        if not self.tolerances.refocused:
            return draw
        parts = [self._on_grid(draw, draw, field) for field in self._all_round()]
        left = torch.cat([(true - first) - (true - first).mean() for true, first, _ in parts])
        back = torch.cat([each - each.mean() for _, _, each in parts])
        focus = draw.errors.focus - float(left @ back / (back @ back))
        return replace(draw, errors=replace(draw.errors, focus=focus))

    def _all_round(self) -> list[Field]:
        """Places in the field that the sensor is focused for."""
        turns = [
            (tangent, turn) for tangent in self.fields for turn in (QUARTERS if tangent else QUARTERS[:1])
        ]
        return [(tangent * math.cos(turn), tangent * math.sin(turn)) for tangent, turn in turns]

    def _on_grid(self, true: Draw, simple: Draw, field: Field) -> tuple[Tensor, Tensor, Tensor]:
        """Changes of the wave [place], in waves, from a place in the field: by rays, to first order, and with
        each mm that the sensor is moved back."""
        lens = self.camera.lens
        assert isinstance(lens, PrescriptionLens)
        grid = PupilGrid(66, 2 * lens.aperture_radius / 64, lens.aperture_radius)
        right, up = grid.centres[None, :], grid.centres.flip(0)[:, None]
        lit = (lens.field_open(right, up, field) > 0.5) & (right.hypot(up) < lens.aperture_radius)
        ways = self._traced(lens, true, True), self._traced(lens, simple, False)
        first, second = (way(right, up, self.wavelength, field)[lit] / self.wavelength for way in ways)
        squared = (right.square() + up.square())[lit]
        return first, second, squared * (self._back() / 2 / self.wavelength)

    def _slopes_at(self, tangent: float, wavelength: float) -> tuple[Slopes, Tensor, Tensor]:
        """How a wave changes with each error, and polynomials of it, less what moves the image."""
        lens = self.camera.lens
        assert isinstance(lens, PrescriptionLens)
        found = slopes(lens.traced(tangent, wavelength)[0], wavelength)
        of = found if wavelength == self.wavelength else self._slopes(tangent, self.wavelength)[0]
        lit, a, b = of.rays.inside[0], of.rays.a[0], of.rays.b[0]
        weight = area(a, b, lit)
        both = torch.cat([a, -a]), torch.cat([b, b]), torch.cat([weight, weight])
        along = planes(*both, torch.cat([of.even, of.even]))[1] / of.rays.half[0]
        across = planes(*both, torch.cat([of.odd, -of.odd]))[0] / of.rays.half[0]
        s, t = (each[0, :, None] * found.rays.half[0] for each in (found.rays.a, found.rays.b))
        still = replace(found, even=found.even - t * along, odd=found.odd - s * across)
        # the reference keeps what moves the image, for other wavelengths
        return (found if of is found else still), *fitted_slopes(still)

    def _traced(self, lens: PrescriptionLens, draw: Draw, exactly: bool) -> Longer:
        @cache
        def change(wavelength: float, tangent: float, turn: float) -> Change:
            errors = draw.errors.turned(math.sin(turn), math.cos(turn))
            if exactly:
                return self._exact(lens, tangent, wavelength, errors).fitted()
            found, even, odd = self._slopes(tangent, wavelength)
            first, second = found.amounts(errors)
            return Change(even @ first[:, None], odd @ second[:, None])

        def longer(right: Tensor, up: Tensor, wavelength: float, field: Field) -> Tensor:
            tangent, turn = math.hypot(*field), math.atan2(field[1], field[0])
            more, wave = change(wavelength, tangent, turn), lens.traced(tangent, wavelength)[1]
            return quantities_at(wave, more.even, more.odd, right / MM, up / MM, turn)[0].sum(0) * MM

        return longer

    def _exact(self, lens: PrescriptionLens, tangent: float, wavelength: float, errors: Errors) -> Exact:
        """Less what moves the image, by the reference wavelength."""
        found, own = (
            exact(lens.traced(tangent, at)[0], at, lens.traced(tangent, at)[1], errors)
            for at in (wavelength, self.wavelength)
        )
        weight = area(own.a, own.b, own.weight == 1).flatten()
        slope = planes(own.a.flatten(), own.b.flatten(), weight, own.change.flatten()[:, None])[:, 0]
        across, along = slope * found.half / own.half
        return replace(found, change=found.change - across * found.a - along * found.b)

    def _bowl(self, draw: Draw) -> Longer:
        """Of a thin lens: what a longer focal length and a sensor out of its place leave of its parabola."""
        factor = self._power() * draw.power + self._back() * draw.errors.focus

        def longer(right: Tensor, up: Tensor, wavelength: float, field: Field) -> Tensor:
            return (right.square() + up.square()) * (factor / 2)

        return longer

    def _power(self) -> float:
        """Vergence [1/m] with the relative growth of the focal length."""
        return 1 / float(focal_length(self.camera, self.wavelength))

    def _back(self) -> float:
        """Vergence [1/m] with each mm that the sensor is moved back."""
        return -MM / self.camera.sensor_distance**2

    def _by_parabolas(self) -> Tensor:
        """What `_by_rays` is for a thin lens: the mean square of r^2 / 2 over the disc, less its mean, is
        r^4 / 48."""
        each = {POWER: self._power(), FOCUS: self._back()}
        factors = [each.get(part.kind, 0.0) * part.deviation for part, _ in self._axes]
        scale = self.camera.aperture_radius**2 / math.sqrt(48) / self.wavelength
        waves = torch.tensor([*factors, each[FOCUS]], dtype=torch.float64) * scale
        return torch.outer(waves, waves)

    def _by_rays(self, each: Sequence[Errors]) -> Tensor:
        """Mean products [error, error] of the waves of errors over pupil and field, less what moves the
        image."""
        total = torch.zeros(len(each), len(each), dtype=torch.float64)
        places = self._all_round()
        for right, up in places:
            tangent, turn = math.hypot(right, up), math.atan2(up, right)
            found = self._slopes(tangent, self.wavelength)[0]
            a, b = found.rays.a[0], found.rays.b[0]
            weight = area(a, b, found.rays.inside[0])
            a, b, weight = torch.cat([a, -a]), torch.cat([b, b]), torch.cat([weight, weight])
            turned = (errors.turned(math.sin(turn), math.cos(turn)) for errors in each)
            waves = torch.stack([first_order(found, errors).flatten() for errors in turned], -1)
            total += _products(a, b, weight, waves / (self.wavelength / MM))
        return total / len(places)

    def _mask_waves(self) -> float:
        """Waves, root mean square, of the mask's relief, less what moves the image."""
        radius = self.camera.aperture_radius
        grid = PupilGrid(MASK_SAMPLES, 2 * radius / (MASK_SAMPLES - 2), radius)
        height = surface(self.camera, grid)
        if height is None:
            return 0.0
        lit = grid.radius_squared() < radius**2
        y, x = (each[lit] / radius for each in torch.meshgrid(grid.centres, grid.centres, indexing="ij"))
        index = float(self.camera.mask_material.index(self.wavelength))
        waves = height.detach()[lit].double()[:, None] * ((index - 1) / self.wavelength)
        return math.sqrt(float(_products(x, y, torch.ones_like(x), waves)))


def area(a: Tensor, b: Tensor, lit: Tensor) -> Tensor:
    """Weights by which rays in rings, denser at the rim, stand for equal areas, 0 where they are not lit.

    a, b: any shape [...], in the disc.
    lit: any shape [...], the same.
    """
    return torch.hypot(a, b).clamp_min(0.05) ** (-2 / 3) * lit


def _products(a: Tensor, b: Tensor, weight: Tensor, waves: Tensor) -> Tensor:
    """Weighted mean products [quantity, quantity] of waves [place, quantity], less the planes nearest to
    them."""
    terms = torch.stack([torch.ones_like(a), a, b], -1)
    root = weight.sqrt()[:, None]
    plane = torch.linalg.lstsq(terms * root, waves * root, driver="gelsd").solution
    left = (waves - terms @ plane) * root
    return left.T @ left / weight.sum()
