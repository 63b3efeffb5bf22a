"""The plano-convex lens."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Literal

from pydantic import ValidationInfo, model_validator
from torch import Tensor

from ...recipe.base import Positive, renamed
from ..materials import Material, material
from .base import Lens, refracting


class PlanoConvexLens(Lens):
    """A thin plano-convex lens of one glass, f = R / (n - 1). Its curved side is a sphere (Akpinar et al.,
    Eq. `spherical`), which aberrates, or the parabola that the sphere starts as (Eq. `paraboliclens`).
    """

    kind: Literal["plano-convex"] = "plano-convex"
    material: str = "fused-silica"
    """name of the glass"""
    radius_of_curvature_mm: Positive = 16.51
    """radius of the curved side, mm; the focal length is that over n - 1"""
    aperture_radius_mm: Positive = 2.5
    """radius of the aperture, mm"""
    surface_profile: Literal["spherical", "parabolic"] = "spherical"
    """"spherical": a sphere, which aberrates; "parabolic": the parabola that it starts as"""

    @model_validator(mode="before")
    @classmethod
    def _old_names(cls, data: object, info: ValidationInfo) -> object:
        if not isinstance(data, Mapping):
            return data
        return renamed(data, "thickness", "surface_profile", {"exact": "spherical"}, info)

    @property
    def aperture_radius(self) -> float:
        return self.aperture_radius_mm * 1e-3

    @property
    def glass(self) -> Material:
        return material(self.material)

    def focal_length(self, wavelengths: Tensor | float) -> Tensor:
        return self.radius_of_curvature_mm * 1e-3 / (self.glass.index(wavelengths) - 1)

    def phase(self, radius_squared: Tensor, wavelength: float) -> Tensor:
        return self.phases(radius_squared)(wavelength)

    def phases(self, radius_squared: Tensor) -> Callable[[float], Tensor]:
        sag = self._sag(radius_squared)
        return lambda wavelength: sag * -self._delay(wavelength)

    def slope(self, radii: Tensor, wavelength: float) -> Tensor:
        if self.surface_profile == "parabolic":
            return radii * 0
        curvature = self.radius_of_curvature_mm * 1e-3
        exact = radii / (curvature**2 - radii**2).sqrt()
        return -self._delay(wavelength) * (exact - radii / curvature)

    def _sag(self, radius_squared: Tensor) -> Tensor:
        """Thickness [m] that the lens does not have beyond its parabola at squared radii [m^2].

        The exact sag R - sqrt(R^2 - q) minus its parabola q / 2R is q^2 / (2 R (R + sqrt(R^2 - q))^2), which
        is evaluated without subtracting large numbers.
        """
        if self.surface_profile == "parabolic":
            return radius_squared * 0
        curvature = self.radius_of_curvature_mm * 1e-3
        root = (curvature**2 - radius_squared).clamp_min(0).sqrt()
        return radius_squared**2 / (2 * curvature * (curvature + root) ** 2)

    def _delay(self, wavelength: float) -> float:
        """Phase [rad] for each metre of glass: 2 pi (n - 1) / lambda, Akpinar et al., Eq. `dtophi`."""
        return 2 * math.pi / wavelength * (float(self.glass.index(wavelength)) - 1)

    def problems(self) -> list[str]:
        found: list[str] = []
        refracting("lens.material", self.material, found)
        if self.aperture_radius_mm >= self.radius_of_curvature_mm:
            found.append(
                f"lens.aperture_radius_mm = {self.aperture_radius_mm:g} does not fit a lens of"
                f" radius_of_curvature_mm = {self.radius_of_curvature_mm:g}; it must be smaller"
            )
        return found

    def glasses(self) -> tuple[Material, ...]:
        return (self.glass,)

    @property
    def aberrates(self) -> bool:
        return self.surface_profile == "spherical"

    def without_spherical_aberration(self) -> Lens:
        return self.model_copy(update={"surface_profile": "parabolic"})
