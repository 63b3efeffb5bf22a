"""The logarithmic phase mask."""

from __future__ import annotations

from typing import Literal

import torch
from torch import Tensor

from .base import Finite, SmoothMask


class LogarithmicMask(SmoothMask):
    """Phase sum over w in {u, v} of sign(w) alpha w^2 (ln|w| + beta).

    S. S. Sherif, W. T. Cathey, E. R. Dowski, "Phase plate to extend the depth of field of incoherent hybrid
    imaging systems", Appl. Opt. 43, 2709 (2004).
    """

    kind: Literal["logarithmic"] = "logarithmic"
    alpha_rad: Finite = 30.0
    """strength of the phase, rad"""
    beta: Finite = 0.2
    """constant that is added to the logarithm"""

    def wavefront(self, u: Tensor, v: Tensor) -> Tensor:
        def profile(w: Tensor) -> Tensor:
            size = w.abs()
            return w.sign() * (torch.xlogy(size**2, size) + self.beta * size**2)

        return self.alpha_rad * (profile(u) + profile(v))
