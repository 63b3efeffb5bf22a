"""What a lens is asked for. A new kind is a class in a file of its own that says the rest.

A lens is thin and its pupil lies in it. To the parabola of its `focal_length`, which defocus is counted from,
it adds a phase that depends on the distance from the axis alone. A lens that `varies` over the field adds
another phase, and shuts parts of its pupil, for each direction that light comes from.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import torch
from pydantic import PrivateAttr, SerializeAsAny
from torch import Tensor

from ...errors import InputError
from ...recipe.kinds import LENSES, KindModel
from ..mask_surface import MaskSurface
from ..materials import Material, material

RIM_SAMPLES = 65
"""Distances from the axis that phases are looked at."""


@dataclass(frozen=True)
class Bend:
    """What defocus is in addition to the parabola.

    focus: inverse depth [1/m] where it is nothing.
    paths: float64 [2, ...], what grows with the inverse depth less that [m^2], and with the square of it
        [m^3].
    """

    focus: float
    paths: Tensor


ChiefRays = tuple[tuple[float, float, float], ...]
"""Chief rays of a lens that distorts: the tangent that a lens without distortion images where one lands, its
own tangent over that, and where it crosses the axis, in mm behind the entrance pupil."""
Field = tuple[float, float]
"""A place in the field: the tangents (right, up) of the angle between the chief ray from there and the axis,
as the camera sees the scene."""
AXIS: Field = (0.0, 0.0)


class Lens(KindModel):
    """The lens of a camera recipe. Lengths are in metres but for the recipe's own keys."""

    @property
    def aperture_radius(self) -> float:
        """Of the pupil."""
        raise NotImplementedError

    def focal_length(self, wavelengths: Tensor | float) -> Tensor:
        """Float64, same shape as `wavelengths`.

        wavelengths: any shape [...], metres.
        """
        raise NotImplementedError

    def phase(self, radius_squared: Tensor, wavelength: float) -> Tensor:
        """Phase [rad] beyond that of the parabola, float64, same shape; positive where light takes longer.

        radius_squared: any shape [...], m^2.
        wavelength: metres.
        """
        raise NotImplementedError

    def phases(self, radius_squared: Tensor) -> Callable[[float], Tensor]:
        """`phase` on one grid for many wavelengths; what does not depend on these may be computed once.

        radius_squared: any shape [...], m^2.
        """
        return lambda wavelength: self.phase(radius_squared, wavelength)

    def slope(self, radii: Tensor, wavelength: float) -> Tensor:
        """Slope of the phase along the radius [rad/m] at `radii`, float64.

        radii: any shape [...], metres.
        wavelength: metres.
        """
        step = self.aperture_radius * 1e-4
        after, before = (self.phase((radii + turn * step).square(), wavelength) for turn in (1, -1))
        return (after - before) / (2 * step)

    @property
    def varies(self) -> bool:
        """Whether points of the scene in other directions have other PSFs: whether `field_phase`,
        `field_open` or `illumination` say anything."""
        return False

    @property
    def round(self) -> bool:
        """Whether a lens that `varies` is the same all round its axis: PSFs of places as far from it are each
        other, turned."""
        return False

    def field_phase(self, right: Tensor, up: Tensor, wavelength: float, field: Field) -> Tensor:
        """Phase [rad] that is added to `phase` for light from `field`, at places of the pupil seen from the
        sensor towards the scene, float64. Positive where light takes longer.

        right: [1, n], metres.
        up: [n, 1], metres.
        wavelength: metres.
        field: tangents (right, up), see `Field`.
        """
        return torch.zeros(torch.broadcast_shapes(right.shape, up.shape), dtype=torch.float64)

    def bend(self, right: Tensor, up: Tensor, field: Field) -> Bend | None:
        """What the depth of a point adds to the parabola of defocus and to `field_phase`, at places as there;
        None where it adds nothing.

        right: [1, n], metres.
        up: [n, 1], metres.
        field: tangents (right, up), see `Field`.
        """
        return None

    def field_open(self, right: Tensor, up: Tensor, field: Field) -> Tensor:
        """Fraction of the light from `field` that the lens lets through there, 0 to 1, shaped likewise: grey
        where an edge crosses a cell.

        right: [1, n], metres.
        up: [n, 1], metres.
        field: tangents (right, up), see `Field`.
        """
        return torch.ones(torch.broadcast_shapes(right.shape, up.shape), dtype=torch.float64)

    @property
    def measured(self) -> bool:
        """Whether it is known by `psfs`: then nothing is known of its pupil."""
        return False

    def psfs(
        self, field: Field, wavelengths: Tensor, inverse_depths: Tensor, pixel: float, window: int
    ) -> Tensor:
        """Of a `measured` lens: PSFs [depth, band, y, x] from `field`; fractions of the light, upright.

        wavelengths: [band], metres.
        inverse_depths: [depth], 1/m.
        field: tangents (right, up), see `Field`.
        pixel: side of a pixel, metres.
        window: pixels along a side; the chief ray's is at n // 2.
        """
        raise NotImplementedError

    def in_folder(self, base: Path) -> Lens:
        """The same lens, whose files are relative to a folder."""
        return self

    def slant(self, field: Field) -> float:
        """Sine of the angle with the axis, in air, at which the chief ray from `field` meets a mask in the
        stop; 0 for a lens that takes all light to pass it along the axis."""
        return 0.0

    def in_stop(self, right: Tensor, up: Tensor, field: Field) -> Tensor | None:
        """Where light from `field` that leaves the lens there meets a mask in the stop, (u, v) in radii of
        the pupil, [2, n, n]; None for a lens that takes it to be there, too.

        right: [1, n], metres.
        up: [n, 1], metres.
        """
        return None

    def misplaced(self, surface: MaskSurface, wavelength: float, field: Field) -> float:
        """By how many waves, root mean square over the pupil, the path of light from `field` differs from
        what it is where a mask in the stop adds to it and does not bend it. wavelength: metres."""
        return 0.0

    def illumination(self, field: Field) -> float:
        """Light on the sensor from `field` over that from the axis, but for what `field_open` shuts out."""
        return 1.0

    def chief(self, place: Field) -> Field:
        """Of the chief ray that lands where a lens without distortion images light of tangents `place`.

        place: tangents (right, up).

        Raises InputError where there is none.
        """
        return place

    def lands(self, field: Field) -> Field:
        """Where the chief ray of a place in the field lands: what `chief` is the inverse of."""
        return field

    def chief_rays(self, farthest: float) -> ChiefRays:
        """Those that land out to a tangent `farthest`, by equal steps of its square, or as far as there are
        any; none for a lens without distortion."""
        return ()

    def at_sensor(self, vergence: float) -> tuple[Lens, float]:
        """The same lens before a sensor where, by the thin lens, it is at 1 / vergence [1/m]; and how far [m]
        behind a thin lens a sensor is that has its pixels see as much."""
        return self, 1 / vergence

    def focused_at(self, distance: float, wavelength: float) -> Lens:
        """The same lens as it is when the camera is focused at a distance [m], at a wavelength [m]: where
        that changes what it adds to its parabola."""
        return self

    def problems(self) -> list[str]:
        """Why there can be no such lens; each a sentence that names the key of the recipe."""
        return []

    def glasses(self) -> tuple[Material, ...]:
        """What it is made of, where the data of these say at which wavelengths it can be used."""
        return ()

    @property
    def aberrates(self) -> bool:
        """Whether it has spherical aberration: a phase beyond the parabola."""
        return True

    @property
    def disperses(self) -> bool:
        """Whether it refracts each wavelength differently."""
        return True

    def without_spherical_aberration(self) -> Lens:
        """A lens of the same focal lengths that adds no phase to its parabola."""
        return WithoutSphericalAberration(lens=self) if self.aberrates else self

    def without_dispersion(self, wavelength: float) -> Lens:
        """A lens that refracts all wavelengths as this one refracts `wavelength` [m]."""
        return WithoutDispersion(lens=self, wavelength=wavelength) if self.disperses else self

    def identity(self) -> str:
        """All that its phases and focal lengths follow from, as JSON, for keys: the recipe's values, its
        glasses by their indices, and the code of another package's lens."""
        said = [each.formula for each in self.glasses()]
        return json.dumps([self.model_dump(mode="json"), said, LENSES.code_of(self.kind)], sort_keys=True)

    def waves_at_most(self, wavelength: float) -> float:
        """The largest phase beyond the parabola within the pupil, in waves of `wavelength` [m]."""
        radii = torch.linspace(0, self.aperture_radius, RIM_SAMPLES, dtype=torch.float64)
        return float(self.phase(radii.square(), wavelength).abs().max()) / (2 * torch.pi)


class _Simpler(Lens):
    """A lens with something left out."""

    lens: SerializeAsAny[Lens]
    """the lens that something is left out of"""

    @property
    def aperture_radius(self) -> float:
        return self.lens.aperture_radius

    def focal_length(self, wavelengths: Tensor | float) -> Tensor:
        return self.lens.focal_length(wavelengths)

    def glasses(self) -> tuple[Material, ...]:
        return self.lens.glasses()

    @property
    def varies(self) -> bool:
        return self.lens.varies

    @property
    def round(self) -> bool:
        return self.lens.round

    @property
    def aberrates(self) -> bool:
        return self.lens.aberrates

    @property
    def disperses(self) -> bool:
        return self.lens.disperses

    def field_phase(self, right: Tensor, up: Tensor, wavelength: float, field: Field) -> Tensor:
        return self.lens.field_phase(right, up, wavelength, field)

    def bend(self, right: Tensor, up: Tensor, field: Field) -> Bend | None:
        return self.lens.bend(right, up, field)

    def field_open(self, right: Tensor, up: Tensor, field: Field) -> Tensor:
        return self.lens.field_open(right, up, field)

    def slant(self, field: Field) -> float:
        return self.lens.slant(field)

    def in_stop(self, right: Tensor, up: Tensor, field: Field) -> Tensor | None:
        return self.lens.in_stop(right, up, field)

    def misplaced(self, surface: MaskSurface, wavelength: float, field: Field) -> float:
        return self.lens.misplaced(surface, wavelength, field)

    def illumination(self, field: Field) -> float:
        return self.lens.illumination(field)

    def chief(self, place: Field) -> Field:
        return self.lens.chief(place)

    def lands(self, field: Field) -> Field:
        return self.lens.lands(field)

    def chief_rays(self, farthest: float) -> ChiefRays:
        return self.lens.chief_rays(farthest)

    def identity(self) -> str:
        return json.dumps([self.model_dump(mode="json", exclude={"lens"}), self.lens.identity()])


class WithoutSphericalAberration(_Simpler):
    """A lens that focuses every point on the axis into a point, with the focal lengths of another one."""

    kind: Literal["without spherical aberration"] = "without spherical aberration"

    def phase(self, radius_squared: Tensor, wavelength: float) -> Tensor:
        return radius_squared * 0

    @property
    def aberrates(self) -> bool:
        return False


class WithoutDispersion(_Simpler):
    """A lens that delays all wavelengths as much as another one delays `wavelength` [m]."""

    kind: Literal["without dispersion"] = "without dispersion"
    wavelength: float
    """wavelength whose delay all wavelengths have, m"""

    def focal_length(self, wavelengths: Tensor | float) -> Tensor:
        shape = torch.as_tensor(wavelengths, dtype=torch.float64)
        return self.lens.focal_length(self.wavelength).expand_as(shape)

    def phase(self, radius_squared: Tensor, wavelength: float) -> Tensor:
        return self.lens.phase(radius_squared, self.wavelength) * (self.wavelength / wavelength)

    def phases(self, radius_squared: Tensor) -> Callable[[float], Tensor]:
        known = self.lens.phase(radius_squared, self.wavelength)
        return lambda wavelength: known * (self.wavelength / wavelength)

    @property
    def disperses(self) -> bool:
        return False


Longer = Callable[[Tensor, Tensor, float, Field], Tensor]
"""A way of light [m] at places of the pupil, at a wavelength, from a place in the field, as `field_phase`."""


class ChangedLens(_Simpler):
    """Another lens as it is made: with more to its phase. Its pupil, and how defocus changes with depth, stay
    those of the other."""

    kind: Literal["changed"] = "changed"
    errors: str
    """what it differs by, in words that tell it from all others"""
    _longer: Longer = PrivateAttr()

    @classmethod
    def of(cls, lens: Lens, errors: str, longer: Longer) -> ChangedLens:
        """A lens whose light takes a `longer` way, by what is said in `errors`."""
        made = cls(lens=lens, errors=errors)
        made._longer = longer
        return made

    def phase(self, radius_squared: Tensor, wavelength: float) -> Tensor:
        return self.lens.phase(radius_squared, wavelength)

    @property
    def varies(self) -> bool:
        return True

    @property
    def round(self) -> bool:
        return False

    def field_phase(self, right: Tensor, up: Tensor, wavelength: float, field: Field) -> Tensor:
        more = self._longer(right, up, wavelength, field) * (2 * torch.pi / wavelength)
        return self.lens.field_phase(right, up, wavelength, field) + more


def refracting(key: str, name: str, problems: list[str]) -> Material | None:
    """The glass of that name. One that there is not, or that does not refract, is a problem of the recipe's
    `key`."""
    try:
        glass = material(name)
    except InputError as error:
        problems.extend(f"{key}: {problem}" for problem in error.problems)
        return None
    if float(glass.index((glass.shortest + glass.longest) / 2)) <= 1:
        problems.append(f"{key}: {glass.name} does not refract; a lens needs a glass")
        return None
    return glass
