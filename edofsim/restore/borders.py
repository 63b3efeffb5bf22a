"""What lies beyond the border of a picture, where nobody knows: a guess that goes on from what is inside."""

from __future__ import annotations

import torch
from torch import Tensor

from ..core.images import mirrored


def continued(image: Tensor, reach: int, *, turned: bool) -> Tensor:
    """An image [.., y, x] with what may lie beyond it, as far as `reach` pixels on each side.

    Its mirror image, which is what goes on where the world itself is made by mirroring; or, turned, that
    image turned about the border's value, which goes on with the slope, too. The light that something beyond
    the border spreads into the picture rises towards it: folded back it looks like a line on the border.
    """
    rows, columns = (mirrored(torch.arange(-reach, n + reach), n).to(image.device) for n in image.shape[-2:])
    mirror = image.index_select(-2, rows).index_select(-1, columns)
    if not turned:
        return mirror
    rows, columns = (
        torch.arange(-reach, n + reach).clamp(0, n - 1).to(image.device) for n in image.shape[-2:]
    )
    border = image.index_select(-2, rows).index_select(-1, columns)
    beyond = (2 * border - mirror).clamp_min(0)
    beyond[..., reach : reach + image.shape[-2], reach : reach + image.shape[-1]] = image
    return beyond
