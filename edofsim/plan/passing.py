"""What a photo keeps of light with other surfaces in front of it.

A surface of coverage c and light F, blurred by the PSF f, in front of light B, blurred by b, gives
f * (c F) + (1 - f * c) (b * B): what is behind goes on there, and is dimmed. Where PSFs change by df and db,
the photo changes by

    df * (c F) - (df * c) (b * B) + (1 - f * c) (db * B),

of which the second is about df * (c B) near the silhouette, where all of this happens. So a photo changes as
if nothing hid anything, but for two things: light behind goes on where it is hidden and is taken from what
hides it, and light at a depth is dimmed by what is nearer. Without them a silhouette has the contrast of its
surface against nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from .fragments import Fragments, nearest

NEARER_PX = 2.0
"""What is nearer by so much blur hides. This, `IN_FULL` and `SLABS` were chosen on members 902 of ten
families and on whole frames of eight shipped scenes."""
IN_FULL = 0.25
"""Share of the pupil from which light counts in full."""
SLABS = 7
"""Ranges of depth, at most, that are dimmed by themselves."""


@dataclass(frozen=True)
class Nearer:
    """nodes: float64 [node], inverse depths; coverage: [tile, node + 1, y, x], blurred, of all that is at
    each node or nearer, and nothing at last; gap: in 1/m, see `NEARER_PX`."""

    nodes: Tensor
    coverage: Tensor
    gap: float

    def passed(self, depth: Tensor) -> Tensor:
        """What share of light at one inverse depth reaches the sensor, [tile, y, x]."""
        return (1 - self.coverage[:, int(self._beyond(depth))]).clamp(0, 1)

    def shown(self, fragments: Fragments) -> Tensor:
        """How far each fragment [n] counts: in full but where the pupil hardly sees it."""
        size = self.coverage[0, 0].numel()
        at = self._beyond(fragments.depth) * size + fragments.place % size
        hidden = self.coverage.flatten(1)[fragments.place // size, at].clamp(0, 1)
        return ((1 - hidden) / IN_FULL).clamp_max(1)

    def _beyond(self, depth: Tensor) -> Tensor:
        """The first node that is nearer by the gap, as its number."""
        return nearest(depth + self.gap, self.nodes) + 1


def nearer_of(cover: Tensor, otfs: Tensor, nodes: Tensor, gap: float) -> Nearer:
    """cover: of fragments at nodes [tile, node, y, x]; otfs: complex [node, y, x // 2 + 1]."""
    side = cover.shape[-2:]
    blurred = torch.fft.irfft2(torch.fft.rfft2(cover) * otfs, s=side)
    nearer = blurred.flip(1).cumsum(1).flip(1)
    return Nearer(nodes, torch.cat([nearer, torch.zeros_like(nearer[:, :1])], 1), gap)
