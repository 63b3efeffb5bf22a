"""The tangent phase mask."""

from __future__ import annotations

from typing import Annotated, Literal

import torch
from pydantic import Field
from torch import Tensor

from .base import Finite, SmoothMask


class TangentMask(SmoothMask):
    """Phase alpha (u^2 tan(beta u) + v^2 tan(beta v)).

    S. Chen, Z. Fan, Z. Xu, B. Zuo, S. Wang, H. Xiao, "Optimized asymmetrical tangent phase mask to obtain
    defocus invariant modulation transfer function in incoherent imaging systems", Opt. Lett. 39, 2171 (2014).
    |beta| < pi/2 keeps the tangent finite over the pupil.
    """

    kind: Literal["tangent"] = "tangent"
    alpha_rad: Finite = 30.0
    """strength of the phase, rad"""
    beta_rad: Annotated[float, Field(gt=-1.57, lt=1.57)] = 0.8
    """argument of the tangent at the pupil's edge, rad"""

    def wavefront(self, u: Tensor, v: Tensor) -> Tensor:
        # beyond the pupil, in the corners of the grid, the tangent may run away: it is dark there
        u, v = u.clamp(-1, 1), v.clamp(-1, 1)
        return self.alpha_rad * (u**2 * torch.tan(self.beta_rad * u) + v**2 * torch.tan(self.beta_rad * v))
