"""A lens that is ideal on its axis: off it, there is coma, and a rim that shuts a part of the pupil."""

from __future__ import annotations

import math
from typing import Literal

import torch
from torch import Tensor

from edofsim.plugins import Field, ThinLens


class OffAxisLens(ThinLens):
    """Seidel's coma, W131 h rho^3 cos(theta), of `coma` waves at the rim for a tangent of 1 with the
    axis; and a rim as wide as the pupil, whose shadow moves by `shadow` of its radius for the same."""

    kind: Literal["off-axis"]
    coma: float = 0.0
    shadow: float = 0.0
    wavelength_nm: float = 550.0

    @property
    def varies(self) -> bool:
        return True

    def field_phase(self, right: Tensor, up: Tensor, wavelength: float, field: Field) -> Tensor:
        x, y = right / self.aperture_radius, up / self.aperture_radius
        waves = self.coma * self.wavelength_nm * 1e-9 / wavelength
        return 2 * math.pi * waves * (x.square() + y.square()) * (x * field[0] + y * field[1])

    def field_open(self, right: Tensor, up: Tensor, field: Field) -> Tensor:
        r, cell = self.aperture_radius, float(right.flatten()[1] - right.flatten()[0])
        apart = torch.hypot(right - self.shadow * r * field[0], up - self.shadow * r * field[1])
        return ((r + cell - apart) / cell + 0.5).clamp(0, 1)
