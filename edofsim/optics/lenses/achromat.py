"""The cemented doublet, traced ray by ray."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Literal

import numpy as np
import torch
from torch import Tensor

from ...recipe.base import Positive, Triple
from ..materials import Material, material
from .base import Lens, refracting

D_LINE = 587.6e-9
"""Of helium, where focal lengths are stated."""
BEYOND_RIM = 1.03
"""Rays are traced out to this many aperture radii: cells that the edge crosses reach beyond it."""
ORDER = 14
"""Of the polynomial in the squared radius that the wave's shape is interpolated by, at Chebyshev's points."""


class AchromatLens(Lens):
    """A cemented doublet, scaled to `focal_length_mm` at 587.6 nm; `f_number` is that over the aperture's
    diameter.

    Radii of its three surfaces (positive if the centre is behind it), thicknesses of its two glasses on the
    axis; as they stand, those of Thorlabs' catalogue for AC254-050-A (50.2 mm, 25.4 mm wide, for 486 to
    656 nm). Spherical aberration and the shift of the focus with wavelength are those of exact rays from a
    point at infinity; they are taken to be the same for nearer ones.
    """

    kind: Literal["achromat"]
    focal_length_mm: Positive
    """focal length at 587.6 nm, mm; the doublet is scaled to it"""
    f_number: Positive
    """focal length over the aperture's diameter"""
    radii_mm: Triple = (33.3, -22.28, -291.07)
    """radii of the three surfaces, mm; positive if the centre is behind it"""
    thicknesses_mm: tuple[Positive, Positive] = (9.0, 2.5)
    """thicknesses of the two glasses on the axis, mm"""
    materials: tuple[str, str] = ("N-BAF10", "N-SF10")
    """names of the two glasses"""

    @property
    def aperture_radius(self) -> float:
        return self.focal_length_mm * 1e-3 / (2 * self.f_number)

    def glasses(self) -> tuple[Material, ...]:
        return tuple(material(name) for name in self.materials)

    def focal_length(self, wavelengths: Tensor | float) -> Tensor:
        """That at 587.6 nm, and how far the focus lies behind the one there: the sensor sees the focus move,
        not the plane that focal lengths are counted from.

        wavelengths: any shape [...], metres.
        """
        at = torch.as_tensor(wavelengths, dtype=torch.float64)
        moved = [self._focus(float(each))[1] - self._focus(D_LINE)[1] for each in at.flatten()]
        return torch.tensor(moved, dtype=torch.float64).reshape(at.shape) + self.focal_length_mm * 1e-3

    def phase(self, radius_squared: Tensor, wavelength: float) -> Tensor:
        place = radius_squared.clamp_max((BEYOND_RIM * self.aperture_radius) ** 2)
        place = place * (2 / (BEYOND_RIM * self.aperture_radius) ** 2) - 1  # -1 on the axis, 1 at the rim
        coefficients = _wave(self, wavelength)
        higher, highest = torch.zeros_like(place), torch.zeros_like(place)
        for coefficient in coefficients[:0:-1]:  # Clenshaw's sum
            higher, highest = coefficient + 2 * place * higher - highest, higher
        return (coefficients[0] + place * higher - highest) * (2 * math.pi / wavelength)

    def problems(self) -> list[str]:
        found: list[str] = []
        for number, name in enumerate(self.materials):
            refracting(f"lens.materials[{number}]", name, found)
        if 0 in self.radii_mm:
            found.append("lens.radii_mm: a surface with a radius of 0; give a large radius for a plane")
        if found:
            return found
        focal = self._focus(D_LINE, scaled=False)[0]
        if not 0 < focal < math.inf:
            return ["lens.radii_mm: this doublet does not focus; exchange the signs of its radii"]
        wrong = self._too_wide()
        return [f"lens.f_number = {self.f_number:g}: {wrong}"] if wrong else []

    def _too_wide(self) -> str:
        """Why the doublet cannot be as wide as its aperture; empty where it can."""
        radii, thicknesses = self._scaled()
        height = BEYOND_RIM * self.aperture_radius
        if any(abs(radius) <= height for radius in radii):
            return "the aperture is wider than a surface of the doublet; choose a larger f-number"
        sags = [radius - math.copysign(math.sqrt(radius**2 - height**2), radius) for radius in radii]
        edges = [t + b - a for t, a, b in zip(thicknesses, sags[:-1], sags[1:], strict=True)]
        if min(edges) < 0:
            return "the surfaces of the doublet cross within the aperture; choose a larger f-number"
        if not np.isfinite(_path(self, D_LINE, np.array([height]))).all():
            return "rays at the rim of the aperture do not leave the doublet; choose a larger f-number"
        return ""

    def _scaled(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Radii and thicknesses in metres, at the recipe's focal length."""
        scale = self.focal_length_mm * 1e-3 / self._focus(D_LINE, scaled=False)[0]
        return tuple(r * scale for r in self.radii_mm), tuple(t * scale for t in self.thicknesses_mm)

    def _indices(self, wavelength: float) -> tuple[float, ...]:
        """Of air, the two glasses, and air."""
        return 1.0, *(float(glass.index(wavelength)) for glass in self.glasses()), 1.0

    def _focus(self, wavelength: float, scaled: bool = True) -> tuple[float, float]:
        """(focal length, distance of the focus from the last surface) for rays near the axis, in metres, or
        where not `scaled` in the prescription's own millimetres."""
        radii, thicknesses = self._scaled() if scaled else (self.radii_mm, self.thicknesses_mm)
        indices = self._indices(wavelength)
        height, angle = 1.0, 0.0
        for number, radius in enumerate(radii):
            before, after = indices[number : number + 2]
            angle = (before * angle - height * (after - before) / radius) / after
            if number < len(thicknesses):
                height += angle * thicknesses[number]
        return (-1 / angle, -height / angle) if angle else (math.inf, math.inf)


@lru_cache(maxsize=256)
def _wave(lens: AchromatLens, wavelength: float) -> tuple[float, ...]:
    """How much [m] the way to the focus is longer than on the axis: coefficients of Chebyshev polynomials of
    the squared radius, which goes from -1 on the axis to 1 beyond the rim."""
    place = np.cos(np.pi * (np.arange(ORDER + 1) + 0.5) / (ORDER + 1))
    heights = BEYOND_RIM * lens.aperture_radius * np.sqrt((place + 1) / 2)
    longer = _path(lens, wavelength, heights) - _path(lens, wavelength, np.zeros(1))
    return tuple(np.polynomial.chebyshev.chebfit(place, longer, ORDER))


def _path(lens: AchromatLens, wavelength: float, heights: np.ndarray) -> np.ndarray:
    """Optical path [m] of rays parallel to the axis at `heights` [ray], to a sphere about the focus of rays
    near the axis; NaN for one that does not get there. The sphere's radius is the focal length."""
    radii, thicknesses = lens._scaled()
    indices = lens._indices(wavelength)
    y, z = heights.astype(float), np.zeros(len(heights))
    across, along = np.zeros(len(heights)), np.ones(len(heights))
    path = np.zeros(len(heights))
    vertex = 0.0
    with np.errstate(invalid="ignore"):
        for number, radius in enumerate(radii):
            before, after = indices[number : number + 2]
            # from the sphere's centre the ray has the foot m off it: half of the chord is what is left
            middle = (vertex + radius - z) * along - y * across
            foot = (vertex + radius - z) ** 2 + y**2 - middle**2
            way = middle - math.copysign(1.0, radius) * np.sqrt(radius**2 - foot)
            path += before * way
            y, z = y + way * across, z + way * along
            normal = -y / radius, (vertex + radius - z) / radius  # along the ray's way
            cosine = across * normal[0] + along * normal[1]
            ratio = before / after
            bent = np.sqrt(1 - ratio**2 * (1 - cosine**2)) - ratio * cosine
            across, along = ratio * across + bent * normal[0], ratio * along + bent * normal[1]
            vertex += thicknesses[number] if number < len(thicknesses) else 0.0
        focal, behind = lens._focus(wavelength)
        centre = vertex + behind
        middle = (centre - z) * along - y * across
        foot = (centre - z) ** 2 + y**2 - middle**2
        return path + middle - np.sqrt(focal**2 - foot)
