"""The sinusoidal phase mask."""

from __future__ import annotations

from typing import Literal

import torch
from torch import Tensor

from .base import Finite, SmoothMask


class SinusoidalMask(SmoothMask):
    """Phase alpha (u^4 sin(beta u) + v^4 sin(beta v)), an odd function in the family of sinusoidal masks.

    H. Zhao, Y. Li, "Optimized sinusoidal phase mask to extend the depth of field of an incoherent imaging
    system", Opt. Lett. 35, 267 (2010).
    """

    kind: Literal["sinusoidal"] = "sinusoidal"
    alpha_rad: Finite = 30.0
    """strength of the phase, rad"""
    beta_rad: Finite = 1.5
    """argument of the sine at the pupil's edge, rad"""

    def wavefront(self, u: Tensor, v: Tensor) -> Tensor:
        return self.alpha_rad * (u**4 * torch.sin(self.beta_rad * u) + v**4 * torch.sin(self.beta_rad * v))
