"""What counts of a view for the time of its photo: how many fragments lie where, and near which edges."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import torch
from torch import Tensor

from ..capture.crop import crop, with_margin
from ..capture.occlusion.hidden import Tile, tiles_to_composite
from ..capture.occlusion.slabs import Hides, cuts
from ..capture.prepare import blur_per_dioptre
from ..core.once import Once
from ..optics import Camera
from ..render.view import View

BINS = 4096
"""Cells of inverse depth over the range of the view, in which depths are counted."""


@dataclass(frozen=True)
class Slabs:
    """The slabs that a part of a view is composited in.

    occupied: bool [slab, bin], the depths at which each holds fragments; fragments: [slab], how many;
    extents: (rows, columns) that each spans.
    """

    occupied: Tensor
    fragments: tuple[int, ...]
    extents: tuple[tuple[int, int], ...]
    _used: dict[tuple[int, int | None], int] = field(default_factory=dict, repr=False, compare=False)

    def nodes_used(self, layers: int, slab: int | None = None) -> int:
        """Depth nodes that some fragment of a slab (None: of all of them) has a share in."""
        if (layers, slab) not in self._used:
            self._used[layers, slab] = self._nodes_used(layers, slab)
        return self._used[layers, slab]

    def _nodes_used(self, layers: int, slab: int | None) -> int:
        if layers == 1:
            return 1
        here = self.occupied.any(0) if slab is None else self.occupied[slab]
        cells = (torch.nonzero(here).squeeze(1) * (layers - 1) // BINS).clamp_max(layers - 2)
        used = torch.zeros(layers, dtype=torch.bool)
        used[cells] = used[cells + 1] = True
        return int(used.sum())


@dataclass(frozen=True)
class Shape:
    """A view, counted.

    height, width, margin, bands: of the view; one_each: whether every pixel has one fragment; visible:
    fragments that are seen; ends: the range of inverse depths; wavelengths: of the bands, in metres; whole:
    slabs of the view; edges: pixels that hide something; reach: half a PSF of the recipe; gap: in
    inverse depth, from which on one surface hides another; dark: the view with that margin and no light;
    counted: work that was.
    """

    height: int
    width: int
    margin: int
    bands: int
    one_each: bool
    visible: int
    ends: tuple[float, float]
    wavelengths: tuple[float, ...]
    whole: Slabs
    edges: Tensor
    reach: int
    gap: float
    dark: View
    counted: Once = field(default_factory=Once, repr=False, compare=False)

    @property
    def padded_shape(self) -> tuple[int, int]:
        """(rows, columns) of the frame with its margin."""
        return self.height + 2 * self.margin, self.width + 2 * self.margin

    @property
    def fragments(self) -> int:
        return sum(self.whole.fragments)

    @cached_property
    def tiles(self) -> list[Tile]:
        """The parts of the frame that are composited; none: all of it in one go."""
        return tiles_to_composite(self.edges, self, self.reach)

    def slabs(self, tile: Tile) -> Slabs:
        """The slabs of a part of the frame, with surroundings of `reach` pixels."""

        def slabs() -> Slabs:
            part = crop(self.dark, tile.top, tile.left, tile.height, tile.width, self.reach)
            return _slabs_of(part, cuts(part, self.gap), self.ends)

        return self.counted.get(tile, slabs)


def shape_of(view: View, camera: Camera, hidden: Hides, slabs: Sequence[float]) -> Shape:
    """Count a view once, for the work of any simulation of it. hidden: which fragments hide which; slabs:
    inverse depths at which it is cut into them."""
    low, high = (float(end) for end in view.inverse_depth.double().aminmax())
    gap = 1 / blur_per_dioptre(camera)
    reach = camera.recipe.psf.window_px // 2
    dark = view.with_light(view.radiance[:0], view.wavelengths[:0])
    hiding = torch.zeros(view.padded_shape, dtype=torch.bool).flatten()
    hiding[view.pixel[hidden.front]] = True
    return Shape(
        height=view.height,
        width=view.width,
        margin=view.margin,
        bands=view.bands,
        one_each=view.one_each,
        visible=int((~view.hidden).sum()),
        ends=(low, high),
        wavelengths=tuple(view.wavelengths.tolist()),
        whole=_slabs_of(view, slabs, (low, high)),
        edges=torch.nonzero(hiding).squeeze(1),
        reach=reach,
        gap=gap,
        dark=with_margin(dark, reach),
    )


def _slabs_of(view: View, cut: Sequence[float], ends: tuple[float, float]) -> Slabs:
    low, high = ends
    depth = view.inverse_depth.double()
    place = ((depth - low) / max(high - low, 1e-12) * BINS).long().clamp(0, BINS - 1)
    at = torch.tensor(sorted(cut), dtype=torch.float64)
    slab = torch.searchsorted(at, depth)
    occupied = torch.zeros(at.numel() + 1, BINS, dtype=torch.bool)
    occupied[slab, place] = True
    counts = torch.bincount(slab, minlength=at.numel() + 1)
    some = counts > 0
    rows, columns = view.padded_shape
    high = _spans(slab, view.pixel // columns, len(counts), rows)
    wide = _spans(slab, view.pixel % columns, len(counts), columns)
    extents = torch.stack([high, wide], 1)[some].tolist()
    return Slabs(occupied[some], tuple(counts[some].tolist()), tuple((y, x) for y, x in extents))


def _spans(slab: Tensor, place: Tensor, count: int, size: int) -> Tensor:
    """From the first to the last place [fragment], below `size`, of each of so many slabs: int64 [slab]."""
    there = torch.zeros(count, size, dtype=torch.uint8)
    there[slab, place] = 1
    return size - there.argmax(1) - there.flip(1).argmax(1)
