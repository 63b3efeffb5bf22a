"""Nothing hides anything beyond its own pixel: the photo is linear in the visible fragments' light."""

from __future__ import annotations

from torch import Tensor

from ...render.view import View
from ..blurring import Blurring
from ..light import seen


def compose(view: View, blurring: Blurring) -> Tensor:
    """Sum of the visible fragments' blurred light, [channel, y, x] of the padded frame."""
    return blurring.light(view, seen(view))
