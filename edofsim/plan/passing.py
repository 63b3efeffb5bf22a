"""What a photo keeps of light with other surfaces in front of it.

A surface of coverage c and light F, blurred by the PSF f, in front of light B, blurred by b, gives
f * (c F) + (1 - f * c) (b * B): what is behind goes on there, and is dimmed. Where PSFs change by df and db,
the photo changes by

    df * (c F) - (df * c) (b * B) + (1 - f * c) (db * B),

of which the second is about df * (c B) near the silhouette, where all of this happens. So a photo changes as
if nothing hid anything, but for two things: light behind goes on where it is hidden and is taken from what
hides it, and light of each slab of depth is dimmed by those in front. Without them a silhouette has the
contrast of its surface against nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from .fragments import Fragments, Tiled

IN_FULL = 0.25
"""Share of the pupil from which light counts in full."""


@dataclass(frozen=True)
class Passing:
    """cuts: float64 [slab - 1], the inverse depths between slabs, ascending.
    passed: [slab, tile, y, x], what share of the light of each reaches the sensor.
    """

    cuts: Tensor
    passed: Tensor

    def slabs(self, depth: Tensor) -> Tensor:
        """The slab of each inverse depth.

        depth: [n], 1/m.
        """
        return torch.searchsorted(self.cuts, depth)

    def shown(self, fragments: Fragments) -> Tensor:
        """How far each fragment [n] counts: in full but where the pupil hardly sees it."""
        passed = self.passed.flatten(1)[self.slabs(fragments.depth), fragments.place]
        return (passed / IN_FULL).clamp_max(1)


def passing(cover: Tiled, otfs: Tensor, nodes: Tensor, cuts: Tensor, tiles: int) -> Passing:
    """cover: of the fragments at nodes, k = 1, in this many tiles.
    otfs: of nodes, complex [node, y, x // 2 + 1].
    nodes: [node], 1/m.
    cuts: [cut], 1/m.
    """
    side, slab = cover.values.shape[-1], torch.searchsorted(cuts, nodes)
    blurred = cover.transformed().values[:, 0] * otfs[cover.node]
    pairs, which = (slab[cover.node] * tiles + cover.tile).unique(return_inverse=True)
    spectra = blurred.new_zeros(len(pairs), *blurred.shape[1:]).index_add_(0, which, blurred)
    coverage = torch.zeros((len(cuts) + 1) * tiles, side, side)
    coverage[pairs] = torch.fft.irfft2(spectra, s=(side, side))
    coverage = coverage.unflatten(0, (-1, tiles))
    nearer = coverage.flip(0).cumsum(0).flip(0) - coverage
    return Passing(cuts, (1 - nearer).clamp(0, 1))
