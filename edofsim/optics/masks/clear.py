"""No mask."""

from __future__ import annotations

from typing import Literal

from .base import Mask


class ClearMask(Mask):
    """No mask: an open circular aperture."""

    kind: Literal["clear"] = "clear"
