"""The ideal lens, and what others like it derive from."""

from __future__ import annotations

from typing import Literal

import torch
from torch import Tensor

from ...recipe.base import Positive
from .base import Lens


class ThinLens(Lens):
    """A lens of a focal length and an f-number, the same for all wavelengths, that adds no phase but what a
    class of its own says."""

    focal_length_mm: Positive
    """focal length, mm"""
    f_number: Positive
    """focal length over the aperture's diameter"""

    @property
    def aperture_radius(self) -> float:
        return self.focal_length_mm * 1e-3 / (2 * self.f_number)

    def focal_length(self, wavelengths: Tensor | float) -> Tensor:
        return torch.full_like(torch.as_tensor(wavelengths, dtype=torch.float64), self.focal_length_mm * 1e-3)

    def phase(self, radius_squared: Tensor, wavelength: float) -> Tensor:
        return radius_squared * 0

    @property
    def aberrates(self) -> bool:
        return False

    @property
    def disperses(self) -> bool:
        return False


class IdealLens(ThinLens):
    """A thin lens without aberrations, the same for all wavelengths: a point in focus is imaged as the
    aperture diffracts it. `f_number` is the focal length over the aperture's diameter."""

    kind: Literal["ideal"]
