"""Front to back with hidden fragments: slabs of depth, each blurred, each seen through those in front of it.

    J_s = L_s + (1 - A_s) J_{s+1} / K_{s+1},     K_s = A_s + (1 - A_s) [K_{s+1} > 0]

with L_s the blurred light of slab s (near to far), A_s its blurred coverage, and K the coverage of all that
the slabs behind hold. Where the hidden fragments are complete, K is 1 and this is the exact image of
geometric optics for two surfaces of which one is in focus. Where not, light from beside the hole fills it.
"""

from __future__ import annotations

import torch
from torch import Tensor

from ...render.view import View
from ..blurring import Blurring
from ..crop import crop
from ..light import seen
from .slabs import cuts, hides, revealed

TILE = 128
"""Side of the tiles that are composited, in pixels."""
LITTLE = 1e-3
"""Coverage below which nothing is there to be normalised."""


def compose(view: View, blurring: Blurring) -> Tensor:
    """[channel, y, x] of the padded frame; outside the frame itself the image is linear.

    Only tiles that a blur can carry across a depth edge are composited; elsewhere the linear image is exact.
    """
    photo = blurring.light(view, seen(view))
    edges = torch.unique(view.pixel[hides(view, blurring.gap).front])
    if not edges.numel():
        return photo
    columns = view.padded_shape[1]
    rows_of, columns_of = edges // columns - view.margin, edges % columns - view.margin
    reach = blurring.reach
    photo = photo.clone()
    for top in range(0, view.height, TILE):
        for left in range(0, view.width, TILE):
            height, width = min(TILE, view.height - top), min(TILE, view.width - left)
            near = (rows_of >= top - reach) & (rows_of < top + height + reach)
            near &= (columns_of >= left - reach) & (columns_of < left + width + reach)
            if bool(near.any()):
                part = crop(view, top, left, height, width, reach)
                m = view.margin
                photo[:, m + top : m + top + height, m + left : m + left + width] = part.crop_margin(
                    composite(part, blurring)
                )
    return photo


def composite(view: View, blurring: Blurring) -> Tensor:
    """The whole padded frame composited in one go: [channel, y, x]."""
    image, coverage = None, None
    for which in reversed(_slabs(view, cuts(view, blurring.gap))):
        shown = revealed(view, which)
        part = shown / view.coverage[which].clamp_min(torch.finfo(shown.dtype).tiny)
        light = blurring.light(view, which, part)
        opaque = blurring.coverage(view, which, shown).clamp(0, 1)
        if image is None:
            image, coverage = light, opaque
        else:
            # What rounding leaves where there is nothing must not be divided, slab after slab, by little
            there = torch.where(coverage > LITTLE, coverage, 1.0)
            image = light + (1 - opaque) * image / there
            coverage = opaque + (1 - opaque) * coverage / there
    return image


def _slabs(view: View, at: list[float]) -> list[Tensor]:
    """Fragments of each slab, near to far, int64 [n] each; `at`: where the view is cut, from near to far."""
    bounds = [float("inf"), *at, -1.0]
    depth = view.inverse_depth.double()
    inside = (
        torch.nonzero((depth <= near) & (depth > far)).squeeze(1)
        for near, far in zip(bounds, bounds[1:], strict=False)
    )
    return [which for which in inside if which.numel()]
