"""How light becomes channels' images. Each method is one function with the same signature:

    prepare(kernels, response) -> blur;  blur(light, grid) -> [channel, y, x]

kernels: PSFs at depth nodes; response: [channel, band]; grid: of the padded frame, which the image covers. A
blur is linear in the light's radiance, and may be called many times, for frames of any size.
"""

from __future__ import annotations

from collections.abc import Mapping

from . import brute, constant, layered
from .base import Blur, Method

METHODS: Mapping[str, Method] = {
    "brute": brute.prepare,
    "layered": layered.prepare,
    "constant": constant.prepare,
}
GONE: Mapping[str, str] = {"low_rank": "leave the method out: plans gather bands in groups instead"}
"""Methods that there were, and what to do instead."""


def unknown_method(name: str) -> str:
    """What to say of a method that there is not."""
    if name in GONE:
        return f"there is no method {name!r} any more: {GONE[name]}"
    return f"method {name!r} is not known: choose one of {', '.join(METHODS)}"


__all__ = ["METHODS", "Blur", "Method", "unknown_method"]
