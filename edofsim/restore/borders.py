"""What lies beyond the border of a picture, where nobody knows: its mirror image."""

from __future__ import annotations

import torch
from torch import Tensor


def mirrored(start: int, size: int, length: int) -> Tensor:
    """Indices start ... start + size - 1 into an axis of `length` that its mirror images continue; the
    border pixel is repeated."""
    folded = torch.arange(start, start + size).remainder(2 * length)
    return torch.where(folded < length, folded, 2 * length - 1 - folded)


def continued(image: Tensor, reach: int) -> Tensor:
    """An image [.., y, x] with its mirror image as far as `reach` pixels on each side."""
    rows, columns = (mirrored(-reach, n + 2 * reach, n).to(image.device) for n in image.shape[-2:])
    return image.index_select(-2, rows).index_select(-1, columns)
