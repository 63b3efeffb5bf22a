"""A lens: an ideal one but for some waves of spherical aberration, which optics books call W040."""

from __future__ import annotations

import math
from typing import Literal

from torch import Tensor

from edofsim.plugins import ThinLens


class SeidelLens(ThinLens):
    """An ideal lens that adds `waves` of `wavelength_nm` at its rim, by the fourth power of the radius."""

    kind: Literal["seidel"]
    waves: float = 0.0
    wavelength_nm: float = 587.6

    def phase(self, radius_squared: Tensor, wavelength: float) -> Tensor:
        rim = 2 * math.pi * self.waves * self.wavelength_nm * 1e-9 / wavelength
        return rim * (radius_squared / self.aperture_radius**2) ** 2

    @property
    def aberrates(self) -> bool:
        return self.waves != 0
