"""The Bayer mosaic: each pixel sees one colour, and none of the other two."""

from __future__ import annotations

from typing import Literal

import torch
from torch import Tensor

from ...errors import InputError
from .base import SensorEffect, Signal

Bayer = Literal["RGGB", "BGGR", "GRBG", "GBRG"]


class Mosaic(SensorEffect):
    """Colour of the mosaic's top left 2 x 2 pixels, two rows of two letters."""

    kind: Literal["bayer-mosaic"] = "bayer-mosaic"
    pattern: Bayer
    """colours of the mosaic's top left 2 x 2 pixels, row by row"""

    def act(self, signal: Signal, generator: torch.Generator) -> Signal:
        seen = mosaic(signal.image, self.pattern)
        return Signal(signal.image * seen, seen)


def mosaic(image: Tensor, pattern: str) -> Tensor:
    """1 where a pixel sees a channel, else 0: [3, y, x].

    image: [..., 3, y, x].
    pattern: of the four pixels of a cell, such as "RGGB".

    Raises InputError for other than three channels.
    """
    channels, rows, columns = image.shape[-3:]
    if channels != 3:
        raise InputError(f"a Bayer mosaic needs 3 channels, not {channels}: turn it off for this response")
    seen = image.new_zeros(3, rows, columns)
    for k, colour in enumerate(pattern):
        seen["RGB".index(colour), k // 2 :: 2, k % 2 :: 2] = 1
    return seen
