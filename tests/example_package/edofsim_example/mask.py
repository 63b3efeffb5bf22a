"""A mask: phase alpha (u^4 + v^4)."""

from __future__ import annotations

from typing import Literal

from torch import Tensor

from edofsim.plugins import Finite, SmoothMask


class QuarticMask(SmoothMask):
    """Phase alpha (u^4 + v^4)."""

    kind: Literal["quartic"] = "quartic"
    alpha_rad: Finite = 20.0

    def wavefront(self, u: Tensor, v: Tensor) -> Tensor:
        return self.alpha_rad * (u**4 + v**4)
