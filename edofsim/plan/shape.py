"""What counts of a view for the time of its photo: how many fragments lie where, and near which edges."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import torch
from torch import Tensor

from ..capture.occlusion.hidden import Tile, tiles_to_composite
from ..capture.occlusion.slabs import Hides
from ..core.once import Once
from ..optics import Camera
from ..render.view import View

BINS = 512
"""Cells of inverse depth over the range of the view, in which depths are counted."""


@dataclass(frozen=True)
class Slabs:
    """The slabs that parts of a view are composited in, those of all parts one after the other.

    part: int64 [slab, 2], rows and columns of the part of the frame that each is of, without surroundings.
    extent: int64 [slab, 2], that each spans.
    around: [slab], fragments of its part, surroundings included.
    occupied: bool [slab, bin], the depths at which each holds some.
    """

    part: Tensor
    extent: Tensor
    around: Tensor
    occupied: Tensor


@dataclass(frozen=True)
class Shape:
    """A view, counted.

    height, width, margin, bands: of the view.
    one_each: whether every pixel has one fragment.
    fragments, visible: how many there are, and are seen.
    ends: the range of inverse depths.
    wavelengths: of the bands, in metres.
    reach: half a PSF of the recipe.
    slabs: none where nothing hides anything.
    in_tiles: whether parts of the frame are composited, else all of it in one go.
    occupied: bool [bin], of all slabs.
    counted: work that was.
    """

    height: int
    width: int
    margin: int
    bands: int
    one_each: bool
    fragments: int
    visible: int
    ends: tuple[float, float]
    wavelengths: tuple[float, ...]
    reach: int
    slabs: Slabs | None
    in_tiles: bool
    occupied: Tensor
    counted: Once = field(default_factory=Once, repr=False, compare=False)

    @property
    def padded_shape(self) -> tuple[int, int]:
        """(rows, columns) of the frame with its margin."""
        return self.height + 2 * self.margin, self.width + 2 * self.margin


def nodes_used(occupied: Tensor, layers: int) -> Tensor:
    """Of this many depth nodes, how many have a share in fragments at some depths: float64 [slab] for bool
    [slab, bin].

    occupied: [slab, bin], bool.
    """
    if layers == 1:
        return torch.ones(len(occupied), dtype=torch.float64)
    cell = (torch.arange(BINS) * (layers - 1) // BINS).clamp_max(layers - 2)
    used = torch.zeros(len(occupied), layers)
    for node in (cell, cell + 1):
        used.index_add_(1, node, occupied.float())
    return (used > 0).sum(1).double()


def shape_of(view: View, camera: Camera, hidden: Hides, cuts: Sequence[float]) -> Shape:
    """Count a view once, for the work of any simulation of it.

    hidden: which fragments hide which.
    cuts: inverse depths between slabs, which parts of the frame are taken to share.
    """
    low, high = (float(end) for end in view.inverse_depth.double().aminmax())
    reach = camera.recipe.psf.window_px // 2
    depth = view.inverse_depth.double()
    place = ((depth - low) / max(high - low, 1e-12) * BINS).long().clamp(0, BINS - 1)
    slab = torch.searchsorted(torch.tensor(sorted(cuts), dtype=torch.float64), depth)
    edges = torch.unique(view.pixel[hidden.front])
    tiles = tiles_to_composite(edges, view, reach)
    whole = Tile(-view.margin, -view.margin, *view.padded_shape)
    found = [_slabs_within(view, slab, place, part, reach if tiles else 0) for part in tiles or [whole]]
    occupied = torch.zeros(BINS, dtype=torch.bool)
    occupied[place] = True
    return Shape(
        height=view.height,
        width=view.width,
        margin=view.margin,
        bands=view.bands,
        one_each=view.one_each,
        fragments=view.pixel.numel(),
        visible=int((~view.hidden).sum()),
        ends=(low, high),
        wavelengths=tuple(view.wavelengths.tolist()),
        reach=reach,
        slabs=Slabs(*(torch.cat(each) for each in zip(*found, strict=True))) if edges.numel() else None,
        in_tiles=bool(tiles),
        occupied=occupied,
    )


def _slabs_within(view: View, slab: Tensor, place: Tensor, part: Tile, reach: int) -> tuple[Tensor, ...]:
    """The fields of `Slabs` of one part of the frame, with surroundings of this many pixels."""
    columns = view.padded_shape[1]
    y = view.pixel // columns - view.margin - part.top + reach
    x = view.pixel % columns - view.margin - part.left + reach
    rows, wide = part.height + 2 * reach, part.width + 2 * reach
    here = torch.nonzero((y >= 0) & (y < rows) & (x >= 0) & (x < wide)).squeeze(1)
    at, count = slab[here], int(slab.max()) + 1
    occupied = torch.zeros(count, BINS, dtype=torch.bool)
    occupied[at, place[here]] = True
    some = occupied.any(1)
    sides = (y, rows), (x, wide)
    extent = torch.stack([_span(at, where[here], count, side) for where, side in sides], 1)[some]
    many = int(some.sum())
    size = torch.tensor([[part.height, part.width]]).expand(many, 2)
    return size, extent, torch.full((many,), len(here), dtype=torch.float64), occupied[some]


def _span(slab: Tensor, place: Tensor, count: int, side: int) -> Tensor:
    """From the first to the last place [fragment], of `side`, of each of this many slabs: int64 [slab]."""
    there = torch.zeros(count, side, dtype=torch.bool)
    there[slab, place] = True
    first, last = there.byte().argmax(1), side - 1 - there.flip(1).byte().argmax(1)
    return last - first + 1
