"""Slabs: ranges of depth such that what hides something and what it hides lie in different ones.

Within a slab light adds up as if nothing were hidden, which is exact for one connected surface however steep;
between slabs it is composited front to back. So a view is cut in as few places as its hidden fragments ask
for, and there where the fewest surfaces pass through the cut.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from ...render.view import View

BINS = 512
"""Resolution, over the range of the view's inverse depths, at which cuts are placed."""


@dataclass(frozen=True)
class Hides:
    """Pairs of fragments of one pixel, the second behind the first and hidden by it: int64 [pair]."""

    front: Tensor
    behind: Tensor


def hides(view: View, gap: float) -> Hides:
    """Which fragments hide which, over gaps in inverse depth of at least `gap` (1/m).

    A hidden fragment is hidden by the nearest of those in front of it, in its pixel, from which it is that
    far: cutting there serves all that are nearer still.
    """
    behind = torch.nonzero(view.hidden).squeeze(1)
    front = behind - 1
    found: list[Hides] = []
    while behind.numel():
        inside = (front >= 0) & (view.pixel[front.clamp_min(0)] == view.pixel[behind])
        behind, front = behind[inside], front[inside]
        far = view.inverse_depth[front] - view.inverse_depth[behind] >= gap
        found.append(Hides(front[far], behind[far]))
        behind, front = behind[~far], front[~far] - 1
    if not found:
        return Hides(behind, behind)
    return Hides(torch.cat([each.front for each in found]), torch.cat([each.behind for each in found]))


def cuts(view: View, gap: float) -> list[float]:
    """Inverse depths at which the view is cut into slabs, from near to far."""
    found = hides(view, gap)
    if not found.front.numel():
        return []
    depth = view.inverse_depth.detach().double()
    low, high = float(depth.min()), float(depth.max())
    width = (high - low) / BINS
    bins = ((high - depth) / width).floor().long().clamp(0, BINS - 1)  # bin 0 is the nearest
    crossed = torch.bincount(bins, weights=view.coverage.detach().double(), minlength=BINS)
    # a cut after bin k has the bins up to k in front of it
    first, last = bins[found.front], bins[found.behind] - 1
    wide = last >= first
    right_behind = found.behind == found.front + 1
    chosen = _stabbed(crossed, first[wide & right_behind], last[wide & right_behind])
    # where other fragments of the pixel lie between, only if these cuts do not part the two
    for cut in chosen:
        wide &= (first > cut) | (last < cut)
    chosen += _stabbed(crossed, first[wide], last[wide])
    return [high - width * (cut + 1) for cut in sorted(chosen)]


def _stabbed(crossed: Tensor, first: Tensor, last: Tensor) -> list[int]:
    """Bins to cut behind, ascending and as few as can be, one at least from `first` to `last` of each gap
    [gap]; crossed: how much lies in each bin."""
    numbers = torch.unique(last * BINS + first)  # ascending by end, then by beginning
    chosen: list[int] = []
    begin, end = 0, -1
    for next_end, next_begin in (divmod(number, BINS) for number in numbers.tolist()):
        if next_begin <= end:  # the cut so far may still lie in this gap too
            begin, end = max(begin, next_begin), min(end, next_end)
            continue
        if end >= begin:
            chosen.append(_emptiest(crossed, begin, end))
        begin, end = next_begin, next_end
    return [*chosen, _emptiest(crossed, begin, end)] if end >= begin else chosen


def _emptiest(crossed: Tensor, begin: int, end: int) -> int:
    """Where to cut between bins begin and end: in the middle of the longest run of the least-crossed bins."""
    # a cut after bin k passes through what lies in bins k and k + 1
    cost = torch.maximum(crossed[begin : end + 1], crossed[begin + 1 : end + 2])
    least = (cost <= cost.min() + 1e-9).tolist()
    best, run = (0, 0), 0
    for k, good in enumerate([*least, False]):
        if good:
            run += 1
        else:
            best, run = max(best, (run, k - run)), 0
    return begin + best[1] + best[0] // 2


def revealed(view: View, which: Tensor) -> Tensor:
    """Coverage that fragments would be seen with if only they were there: [n].

    which: int64 [n], ascending, of fragments sorted by pixel and depth. Nearer ones come first; together the
    fragments of a pixel cover it once at most.
    """
    coverage = view.coverage[which]
    pixel = view.pixel[which]
    total = torch.cumsum(coverage.double(), 0)
    start = torch.ones_like(pixel, dtype=torch.bool)
    start[1:] = pixel[1:] != pixel[:-1]
    before = torch.where(start, total - coverage, torch.zeros_like(total))
    before = torch.cummax(before, 0).values
    nearer = (total - coverage - before).clamp_min(0).to(coverage.dtype)
    return torch.minimum(coverage, (1 - nearer).clamp_min(0))
