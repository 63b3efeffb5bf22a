"""The cubic phase mask."""

from __future__ import annotations

from typing import Literal

from torch import Tensor

from .base import Finite, SmoothMask


class CubicMask(SmoothMask):
    """Phase alpha (u^3 + v^3).

    E. R. Dowski, W. T. Cathey, "Extended depth of field through wave-front coding", Appl. Opt. 34, 1859
    (1995). With 3 alpha >= 2 |Psi| everywhere in the depth range the caustic stays inside the pupil.
    """

    kind: Literal["cubic"] = "cubic"
    alpha_rad: Finite = 30.0
    """phase at the pupil's edge along u or v, rad"""

    def wavefront(self, u: Tensor, v: Tensor) -> Tensor:
        return self.alpha_rad * (u**3 + v**3)
