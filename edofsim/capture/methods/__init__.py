"""How light becomes channels' images. Each method is one function with the same signature:

    prepare(kernels, response, *, tolerance_db) -> blur;  blur(light, grid) -> [channel, y, x]

kernels: PSFs at depth nodes; response: [channel, band]; grid: of the padded frame, which the image covers. A
blur is linear in the light's radiance, and may be called many times, for frames of any size.
"""

from __future__ import annotations

from collections.abc import Mapping

from . import brute, constant, layered, low_rank
from .base import Blur, Method

METHODS: Mapping[str, Method] = {
    "brute": brute.prepare,
    "layered": layered.prepare,
    "low_rank": low_rank.prepare,
    "constant": constant.prepare,
}

__all__ = ["METHODS", "Blur", "Method"]
