"""Lenses by their surfaces, traced ray by ray over the whole field."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import Annotated, Literal

import numpy as np
import torch
from pydantic import Field as Key
from torch import Tensor

from ...errors import InputError
from ...recipe.base import Positive
from ..mask_surface import MaskSurface
from ..materials import Material
from ..prescription.aim import Focused, axial, chief_planes, focused, on_sphere
from ..prescription.bent_rays import misplaced
from ..prescription.first_order import first_order
from ..prescription.outline import delay, disc, in_stop, light, opening
from ..prescription.polynomials import chebyshev
from ..prescription.pupil import Pupil, pupil, slant_at_stop
from ..prescription.surfaces import Surface, stack
from ..prescription.waves import Wave, landings, tangents_of, waves
from .base import Bend, ChiefRays, Field, Lens

BEYOND_RIM = 1.03
"""Rays are traced out to this many radii of the aperture: cells that the edge crosses reach beyond it."""
ORDER = 14
"""Of the polynomial in the squared radius that the wave on the axis is interpolated by."""
DEPTHS = (0.02, 0.06)
"""Inverse distances from that in focus, times the focal length, that rays are traced from for all others."""
CHIEF_RAYS = 65
"""In the table that views are rendered by."""
HALVINGS = 12
"""Of the part of a frame that may be dark, to find where light ends."""
NEARBY = 1e-9
"""Tangents with the axis below which light is from a point on it."""
MM = 1e-3


class PrescriptionLens(Lens):
    """A lens by its `surfaces`, in the order that light meets them; rays are traced through them from each
    place in the field. Its aperture is `f_number`, or the `clear_radius_mm` of the surface that is the stop.
    Surfaces with a `clear_radius_mm` shut parts of the pupil from outer places.

    Aberrations are those of rays from `traced_at_m`, or from where the camera is focused.
    """

    kind: Literal["prescription"]
    source: str = ""
    """where the numbers are from"""
    surfaces: Annotated[tuple[Surface, ...], Key(min_length=1, max_length=100)]
    """the surfaces, from the scene to the sensor"""
    focal_length_mm: Positive | None = None
    """focal length that all lengths are scaled to, mm; left out, they are as they stand"""
    f_number: Positive | None = None
    """focal length over the diameter of the parallel light that the stop lets through on the axis"""
    traced_at_m: Positive | None = None
    """distance before the entrance pupil that rays are traced from, m; left out, that of the focus"""
    moved_mm: float = 0.0
    """how far the sensor is behind where light of the focus meets near the axis, mm; left out, as the
    camera's focus says"""
    traced_at_nm: Positive = 587.6
    """wavelength of the focal length, the f-number and the chief rays, nm; left out, that of the focus"""

    @property
    def aperture_radius(self) -> float:
        held = _held(self)
        return held.rim * held.scale * MM

    def focal_length(self, wavelengths: Tensor | float) -> Tensor:
        """That of the thin lens with the same focus, and the same size and blur of what lies near the axis,
        for points before the entrance pupil.

        wavelengths: any shape [...], metres.
        """
        held = _held(self)
        at = torch.as_tensor(wavelengths, dtype=torch.float64)
        near = 1 / held.distance + 1 / held.scale
        found = [MM / (near - _farther(self, each) / held.scale**2) for each in at.flatten().tolist()]
        return torch.tensor(found, dtype=torch.float64).reshape(at.shape)

    def phase(self, radius_squared: Tensor, wavelength: float) -> Tensor:
        return self._bowl(_on_axis(self, wavelength), radius_squared).mul_(2 * math.pi * MM / wavelength)

    def _bowl(self, factors: Sequence[float], radius_squared: Tensor) -> Tensor:
        """What polynomials of `_on_axis` say; of a pupil that is its own mirror image, on a quarter of it."""
        half = radius_squared.shape[0] // 2 if radius_squared.ndim == 2 else 0
        upper, lower = radius_squared[:half], radius_squared[half:]
        if half and all(torch.equal(*each) for each in ((upper.flip(0), lower), (lower.flip(1), lower))):
            quarter = self._bowl(factors, lower[:, lower.shape[1] // 2 :].flatten()).reshape(half, -1)
            rows = torch.cat([quarter.flip(1)[:, : lower.shape[1] // 2], quarter], 1)
            return torch.cat([rows.flip(0), rows])
        place = radius_squared.clamp_max((BEYOND_RIM * self.aperture_radius) ** 2)
        place = place * (2 / (BEYOND_RIM * self.aperture_radius) ** 2) - 1  # -1 on the axis, 1 beyond the rim
        total = torch.zeros_like(place)
        for factor in reversed(factors):
            total.mul_(place).add_(factor)
        return total

    @property
    def varies(self) -> bool:
        return True

    @property
    def round(self) -> bool:
        return True

    def field_phase(self, right: Tensor, up: Tensor, wavelength: float, field: Field) -> Tensor:
        tangent, squared = math.hypot(*field), right.square() + up.square()
        if tangent < NEARBY:
            return torch.zeros_like(squared)
        path = delay(_wave(self, tangent, wavelength), right / MM, up / MM, math.atan2(field[1], field[0]))
        path = path - squared / MM**2 * (_farther(self, wavelength) / _held(self).scale ** 2 / 2)
        return path * (2 * math.pi * MM / wavelength) - self.phase(squared, wavelength)

    def bend(self, right: Tensor, up: Tensor, field: Field) -> Bend:
        """By rays of the reference wavelength from two more distances, `DEPTHS`: the path grows with the
        inverse distance, and a little with its square.

        right: [1, n], metres.
        up: [n, 1], metres.
        field: tangents (right, up).
        """
        held, tangent, squared = _held(self), math.hypot(*field), right.square() + up.square()
        focus, turn = 1 / held.distance, math.atan2(field[1], field[0])
        near, far = (each / held.first.focal for each in DEPTHS)
        wavelength = self.traced_at_nm * 1e-9

        def longer(nearer: float) -> Tensor:
            if tangent < NEARBY:
                return self._bowl(_on_axis(self, wavelength, nearer), squared)
            path = delay(_wave(self, tangent, wavelength, nearer), right / MM, up / MM, turn)
            return path - squared / MM**2 * (nearer / 2)

        own = longer(0.0)
        first, second = ((longer(step) - own) / step for step in (near, far))
        curved = (second - first) / (far - near)
        return Bend(focus / MM, torch.stack([first - near * curved, curved * MM]) * MM**2)

    def field_open(self, right: Tensor, up: Tensor, field: Field) -> Tensor:
        """Of the light within the disc of the aperture, on the axis as well: cells that its edge crosses
        count as whole.

        right: [1, n], metres.
        up: [n, 1], metres.
        field: tangents (right, up).
        """
        wave = _wave(self, math.hypot(*field), self.traced_at_nm * 1e-9)
        share = opening(wave, right / MM, up / MM, math.atan2(field[1], field[0]))
        if right.numel() < 3:
            return share
        cell = float((right.flatten()[1] - right.flatten()[0]).abs())
        return (share / disc(right, up, self.aperture_radius, cell).clamp_min(1e-3)).clamp(0, 1)

    def slant(self, field: Field) -> float:
        tangent = math.hypot(*field)
        return 0.0 if tangent < NEARBY else _slant(self, tangent)

    def in_stop(self, right: Tensor, up: Tensor, field: Field) -> Tensor:
        wave = _wave(self, math.hypot(*field), self.traced_at_nm * 1e-9)
        return in_stop(wave, right / MM, up / MM, math.atan2(field[1], field[0]))

    def misplaced(self, surface: MaskSurface, wavelength: float, field: Field) -> float:
        tangent, turn = math.hypot(*field), math.atan2(field[1], field[0])
        seen, wave = _pupil(self, tangent, 0.0), _wave(self, tangent, wavelength)
        return misplaced(seen, wave, wavelength, surface, turn, self.slant(field))

    def illumination(self, field: Field) -> float:
        """What is left but for `field_open`, whose area in direction cosines counts cosines and the pupil's
        size: the light through parts of the pupil that lie beyond the disc of the aperture."""

        def outside(tangent: float) -> float:
            wave = _wave(self, tangent, self.traced_at_nm * 1e-9)
            return light(wave) / light(wave, self.aperture_radius / MM)

        return outside(math.hypot(*field)) / outside(0.0)

    def landing(self, tangents: Tensor) -> Tensor:
        """Where chief rays of tangents [field], not negative, land: the tangents that a lens without
        distortion images there, at the wavelength `traced_at_nm`.

        tangents: [field], not negative.

        Raises InputError where there is no such ray.
        """
        held = _held(self)
        return landings(held, tangents.double()) / held.scale

    def lands(self, field: Field) -> Field:
        tangent = math.hypot(*field)
        if tangent < NEARBY:
            return field
        ratio = float(self.landing(torch.tensor([tangent], dtype=torch.float64))) / tangent
        return field[0] * ratio, field[1] * ratio

    def chief(self, place: Field) -> Field:
        ratio = _chief_ratio(self, math.hypot(*place))
        return place[0] * ratio, place[1] * ratio

    def chief_rays(self, farthest: float) -> ChiefRays:
        return _chief_rays(self, farthest)

    def at_sensor(self, vergence: float) -> tuple[PrescriptionLens, float]:
        lens, held = self, _held(self)
        if "moved_mm" not in self.model_fields_set:
            apart = vergence * MM - 1 / held.scale
            for _ in range(3):  # the sensor's scale follows from where it is
                lens = self.model_copy(update={"moved_mm": -apart * held.scale**2})
                held = _held(lens)
        return lens, held.scale * MM

    def held(self) -> Focused:
        """The lens with its sensor, as rays are traced through it. Raises InputError where there is no
        image."""
        return _held(self)

    def traced(self, tangent: float, wavelength: float) -> tuple[Pupil, Wave]:
        """Of light of a wavelength [m] in focus, from a place in the field. Raises InputError where there is
        none."""
        return _pupil(self, tangent, 0.0), _wave(self, tangent, wavelength)

    def focused_at(self, distance: float, wavelength: float) -> PrescriptionLens:
        """The same lens with its aberrations at a distance [m] before the entrance pupil, and at a wavelength
        [m], but for what its recipe says of either."""
        focus = {
            "traced_at_m": distance if math.isfinite(distance) else None,
            "traced_at_nm": wavelength * 1e9,
        }
        left_open = {key: value for key, value in focus.items() if key not in self.model_fields_set}
        return self.model_copy(update=left_open)

    def wrong_numbers(self) -> list[str]:
        """Of `problems`, those that keep rays from being traced at all."""
        found: list[str] = []
        for number, each in enumerate(self.surfaces):
            found += each.problems(f"lens.surfaces[{number}]")
        stops = [each for each in self.surfaces if each.stop]
        if len(stops) != 1:
            found.append(f"lens.surfaces: {len(stops)} of them are the stop; mark one with stop = true")
        elif (self.f_number is None) == (stops[0].clear_radius_mm is None):
            found.append("lens.f_number: give either it or the clear_radius_mm of the stop")
        if self.surfaces[-1] != self.surfaces[-1].model_copy(
            update={"glass": None, "nd": None, "sellmeier": ()}
        ):
            found.append(
                f"lens.surfaces[{len(self.surfaces) - 1}]: light leaves the last surface into air, not glass"
            )
        return found

    def problems(self) -> list[str]:
        found = self.wrong_numbers()
        if found:
            return found
        try:
            _on_axis(self, self.traced_at_nm * 1e-9)
            _wave(self, 0.0, self.traced_at_nm * 1e-9)
        except InputError as error:
            return [f"lens.surfaces: {problem}" for problem in error.problems]
        return []

    def glasses(self) -> tuple[Material, ...]:
        media = [each.medium() for each in self.surfaces]
        return tuple(dict.fromkeys(medium for medium in media if medium is not None))


@lru_cache(maxsize=4096)
def _chief_ratio(lens: PrescriptionLens, place: float) -> float:
    """The chief ray's tangent over that of the place where it lands."""
    place = max(place, NEARBY)
    held = _held(lens)
    return float(tangents_of(held, torch.tensor([place], dtype=torch.float64) * held.scale)) / place


@lru_cache(maxsize=4096)
def _slant(lens: PrescriptionLens, tangent: float) -> float:
    return float(slant_at_stop(_held(lens), torch.tensor([tangent], dtype=torch.float64)))


@lru_cache(maxsize=64)
def _chief_rays(lens: PrescriptionLens, farthest: float) -> ChiefRays:
    held = _held(lens)
    steps = torch.linspace(0, 1, CHIEF_RAYS, dtype=torch.float64).sqrt()

    def out_to(place: float) -> tuple[Tensor, Tensor]:
        places = (steps * place).clamp_min(NEARBY)
        return places, tangents_of(held, places * held.scale)

    known, beyond = NEARBY, farthest
    try:
        places, tangents = out_to(farthest)
    except InputError:  # some of the frame is dark: as far as there is light
        for _ in range(HALVINGS):
            middle = (known + beyond) / 2
            try:
                out_to(middle)
                known = middle
            except InputError:
                beyond = middle
        places, tangents = out_to(known)
    crossing = chief_planes(held, tangents) - held.first.entrance
    rows = torch.stack([places * (places > NEARBY), tangents / places, crossing], -1).tolist()
    return tuple((_rounded(place), _rounded(ratio), _rounded(at)) for place, ratio, at in rows)


def _rounded(number: float) -> float:
    """So that views have the same keys wherever their chief rays were traced."""
    return float(f"{number:.7g}") if abs(number) > 1e-7 else 0.0


@lru_cache(maxsize=64)
def _held(lens: PrescriptionLens) -> Focused:
    """The lens with a sensor where it is traced to. Raises InputError where there is no image."""
    problems = lens.wrong_numbers()
    if problems:
        raise InputError(problems)
    wavelength, scale = lens.traced_at_nm * 1e-9, 1.0
    surfaces = stack(lens.surfaces)
    if lens.focal_length_mm is not None:
        index = surfaces.index(torch.tensor([wavelength], dtype=torch.float64))
        scale = lens.focal_length_mm / first_order(surfaces, index[0]).focal
        if not 0 < scale < math.inf:
            raise InputError("these surfaces do not focus light; look at the signs of their radii")
        surfaces = stack(lens.surfaces, scale)
    distance = math.inf if lens.traced_at_m is None else lens.traced_at_m / MM
    opening_ = None
    if lens.f_number is not None:
        index = surfaces.index(torch.tensor([wavelength], dtype=torch.float64))
        opening_ = first_order(surfaces, index[0]).focal / (2 * lens.f_number)
    return focused(surfaces, wavelength, distance, opening_, lens.moved_mm)


@lru_cache(maxsize=1024)
def _farther(lens: PrescriptionLens, wavelength: float) -> float:
    """How far [mm] behind the sensor light of a wavelength is in focus near the axis."""
    held = _held(lens)
    index = held.lens.index(torch.tensor([wavelength], dtype=torch.float64))
    return first_order(held.lens, index[0]).image(held.distance - held.first.entrance)[0] - held.sensor


@lru_cache(maxsize=1024)
def _on_axis(lens: PrescriptionLens, wavelength: float, nearer: float = 0.0) -> tuple[float, ...]:
    """How much [mm] the way of light from the axis is longer than along it, and than the parabola, from
    where the inverse distance [1/mm] is more than that in focus by so much: coefficients of Chebyshev
    polynomials of the squared radius, which goes from -1 on the axis to 1 beyond the rim."""
    held = _held(lens)
    index = held.lens.index(torch.tensor([wavelength], dtype=torch.float64))
    heights = (
        torch.linspace(0, 1.1, 4 * ORDER, dtype=torch.float64).sqrt() * held.entrance_radius * BEYOND_RIM
    )
    vergence = 1 / held.distance + nearer
    rays, path = axial(held, index, heights[None], 1 / vergence if vergence else math.inf)
    _, place, back = on_sphere(held, rays, torch.zeros(1, dtype=torch.float64))
    squared, longer = (place[0] * held.scale).square(), (path - back)[0]
    parabola = _farther(lens, wavelength) / held.scale**2 + nearer
    longer = longer - longer[0] - squared * (parabola / 2)
    scaled = squared * (2 / (BEYOND_RIM * held.rim * held.scale) ** 2) - 1
    fine = torch.isfinite(scaled) & (scaled < 1.05)
    fit = torch.linalg.lstsq(chebyshev(scaled[fine], ORDER + 1), longer[fine, None], driver="gelsd")
    return tuple(np.polynomial.chebyshev.cheb2poly(fit.solution[:, 0].numpy()).tolist())


@lru_cache(maxsize=1024)
def _pupil(lens: PrescriptionLens, tangent: float, nearer: float) -> Pupil:
    held = _held(lens)
    vergence = 1 / held.distance + nearer
    return pupil(held, torch.tensor([tangent], dtype=torch.float64), 1 / vergence if vergence else math.inf)


@lru_cache(maxsize=4096)
def _wave(lens: PrescriptionLens, tangent: float, wavelength: float, nearer: float = 0.0) -> Wave:
    """nearer: as in `_on_axis`."""
    with torch.no_grad():
        return waves(_pupil(lens, tangent, nearer), torch.tensor([wavelength], dtype=torch.float64))[0]
