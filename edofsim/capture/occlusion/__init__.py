"""How surfaces hide each other. Each way is one function with the same signature:

    photo = compose(view, blurring) -> [channel, y, x] of the padded frame

none: nothing hides anything beyond its own pixel: linear; over: layers with blurred coverage, front to back;
normalised: the same, each divided by the blurred coverage of it and all behind it (Ikoma et al. 2021);
hidden: front to back with the fragments that were rendered behind the visible ones; this one takes the
frame's layout, too.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from torch import Tensor

from .hidden import compose as hidden
from .layers import normalised, over
from .none import compose as none

OCCLUSIONS: Mapping[str, Callable[..., Tensor]] = {
    "none": none,
    "over": over,
    "normalised": normalised,
    "hidden": hidden,
}

__all__ = ["OCCLUSIONS"]
