"""Slabs: ranges of depth such that what hides something and what it hides lie in different ones.

Within a slab light adds up as if nothing were hidden, which is exact for one connected surface however steep;
between slabs it is composited front to back. So a view is cut where its hidden fragments ask for it, through
as few surfaces as can be.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ...render.view import View

BINS = 512
"""Resolution, over the range of the view's inverse depths, at which cuts are placed."""
PRICE = 1.6e-3
"""Of a cut, as a share of the padded frame's pixels: what it mends must be more."""
SMALLEST_GAP = 1e-9
"""In 1/m."""
Array = NDArray[np.float64]


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


def cuts(view: View, gap: float, found: Hides | None = None) -> list[float]:
    """Inverse depths at which the view is cut into slabs, from near to far: those at which the light that
    cuts leave wrong is least. A cut is wrong in as much coverage as lies next to it, and costs time as well
    (`PRICE`); a pair that no cut parts is wrong in the coverage of what hides, for each `gap` between the two
    once.

    found: what `hides` gives, where that is known.
    """
    found = hides(view, gap) if found is None else found
    if not found.front.numel():
        return []
    depth = view.inverse_depth.detach().double().cpu()
    coverage = view.coverage.detach().double().cpu()
    front, behind = found.front.cpu(), found.behind.cpu()
    low, high = float(depth.min()), float(depth.max())
    width = (high - low) / BINS
    bins = ((high - depth) / width).floor().long().clamp(0, BINS - 1)  # bin 0 is the nearest
    crossing = crossed(torch.bincount(bins, weights=coverage, minlength=BINS).numpy())
    # a cut behind bin k has the bins up to k in front of it
    first, last = bins[front], bins[behind] - 1
    wrong = coverage[front] * (depth[front] - depth[behind]) / max(gap, SMALLEST_GAP)
    wide = last >= first
    # [a, b]: of all pairs between which the cuts behind bins a to b part
    pairs = torch.bincount((first * BINS + last)[wide], weights=wrong[wide], minlength=BINS * BINS)
    price = PRICE * view.padded_shape[0] * view.padded_shape[1]
    chosen = _cheapest(crossing, pairs.reshape(BINS, BINS).numpy(), price)
    return [high - width * (cut + 1) for cut in chosen]


def crossed(coverage: Array) -> Array:
    """What a cut behind each bin passes through [bin], of the coverage in each: the more of what lies in the
    bins on either side of it."""
    return np.maximum(coverage, np.append(coverage[1:], 0))


def _cheapest(crossing: Array, pairs: Array, price: float) -> list[int]:
    """Bins behind which to cut, ascending: the best there are, by dynamic programming.

    crossing: [bin], cost of a cut behind each, and price: of any; pairs: [bin, bin], what it costs not to cut
    behind any bin from one to the other.
    """
    count = len(crossing)
    # [a, b]: of all pairs that begin at bin a or behind it and end at b or before it
    within = np.vstack([np.cumsum(np.cumsum(pairs[::-1], 0)[::-1], 1), np.zeros(count)])
    best, before = np.zeros(count + 1), np.zeros(count + 1, np.int64)  # of cuts up to one behind bin k - 1
    for k in range(1, count + 1):
        costs = best[:k] + (within[:k, k - 2] if k > 1 else 0.0)
        before[k] = costs.argmin()
        best[k] = costs[before[k]] + crossing[k - 1] + price
    cut = int((best + within[:, -1]).argmin())
    chosen: list[int] = []
    while cut:
        chosen.append(_middle(crossing, cut - 1))
        cut = int(before[cut])
    return chosen[::-1]


def _middle(crossing: Array, cut: int) -> int:
    """A cut through nothing moved to the middle of where nothing is."""
    if crossing[cut] > 0:
        return cut
    things = np.flatnonzero(crossing > 0)
    after = int(np.searchsorted(things, cut))
    begin = things[after - 1] + 1 if after else 0
    end = things[after] - 1 if after < len(things) else len(crossing) - 1
    return int(begin + end) // 2


def revealed(view: View, which: Tensor) -> Tensor:
    """Coverage that fragments would be seen with if only they were there: [n].

    which: int64 [n], ascending, of fragments sorted by pixel and depth. Nearer ones come first; together the
        fragments of a pixel cover it once at most.
    view: whose fragments they are.
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
