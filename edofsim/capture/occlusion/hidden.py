"""Front to back with hidden fragments: slabs of depth, each blurred, each seen through those in front of it.

    J_s = L_s + (1 - A_s) f(K_{s+1}) J_{s+1} / K_{s+1},     K_s = A_s + (1 - A_s) f(K_{s+1})

with L_s the blurred light of slab s (near to far), A_s its blurred coverage, and K the coverage of all that
the slabs behind hold. Where the hidden fragments are complete, K is 1 and this is the exact image of
geometric optics for two surfaces of which one is in focus. Where not, light from next to the hole fills it:
f(K) = min(1, K / ENOUGH), and 1 behind the nearest slab. Without that bound the tails of a few far pixels'
blur would fill whatever lies between them and a nearer slab.

The products know averages over the pupil alone; `sub_apertures` tells what that leaves out.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Protocol

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
ENOUGH = 0.5
"""Coverage from which on what lies behind a slab counts as complete, up to holes to be filled."""


def compose(view: View, blurring: Blurring, layout: Layout | None = None) -> Tensor:
    """[channel, y, x] of the padded frame; outside the frame itself the image is linear.

    Only tiles that a blur can carry across a depth edge are composited; elsewhere the linear image is exact.

    layout: of the view, or of it with a wider margin; None to choose it here.
    """
    layout = layout_of(view, blurring.gap, blurring.reach) if layout is None else layout
    if layout.whole is not None:
        return composite(view, blurring, layout.whole)
    photo = blurring.light(view, seen(view))
    m = view.margin
    if layout.tiles:
        photo = photo.clone()
    for tile, cut in layout.tiles:
        around = crop(view, tile.top, tile.left, tile.height, tile.width, blurring.reach)
        rows = slice(m + tile.top, m + tile.top + tile.height)
        columns = slice(m + tile.left, m + tile.left + tile.width)
        photo[:, rows, columns] = around.crop_margin(composite(around, blurring, cut))
    return photo


@dataclass(frozen=True)
class Tile:
    top: int
    left: int
    height: int
    width: int


@dataclass(frozen=True)
class Layout:
    """How a frame is composited.

    tiles: its parts, and the inverse depths at which each is cut into slabs.
    whole: those of the whole frame where it is done in one go, else None.
    """

    tiles: tuple[tuple[Tile, list[float]], ...] = ()
    whole: list[float] | None = None


def layout_of(view: View, gap: float, reach: int) -> Layout:
    """The parts of a view that blurs of this many pixels carry light into across depth edges, and their cuts.

    Where there are too many tiles, and their overlaps cost more than the whole frame, that is done in one go.

    gap: in inverse depth, from which on one surface hides another. Photos by PSFs of several widths are alike
        only where their layout is.
    """
    dark = view.with_light(view.radiance[:0], view.wavelengths[:0])
    hidden = hides(dark, gap)
    edges = torch.unique(dark.pixel[hidden.front])
    if not edges.numel():
        return Layout()
    tiles = tiles_to_composite(edges, dark, reach)
    if not tiles:
        return Layout(whole=cuts(dark, gap, hidden))
    parts = (crop(dark, tile.top, tile.left, tile.height, tile.width, reach) for tile in tiles)
    return Layout(tuple((tile, cuts(part, gap)) for tile, part in zip(tiles, parts, strict=True)))


class Framed(Protocol):
    """What has a frame and a margin around it, as a view has."""

    @property
    def height(self) -> int: ...

    @property
    def width(self) -> int: ...

    @property
    def margin(self) -> int: ...

    @property
    def padded_shape(self) -> tuple[int, int]: ...


def tiles_to_composite(edges: Tensor, view: Framed, reach: int) -> list[Tile]:
    """`tiles_near`, or none where they cost more than all of the frame in one go.

    edges: int64 [n], numbers of the padded frame's pixels that are on depth edges.
    view, reach: as of `tiles_near`.
    """
    tiles = tiles_near(edges, view, reach)
    pixels = sum(transform_pixels(tile.height, tile.width, reach) for tile in tiles)
    return tiles if pixels < transform_pixels(view.height, view.width, reach) else []


def tiles_near(edges: Tensor, view: Framed, reach: int) -> list[Tile]:
    """Tiles of the frame that a blur carries light into across an edge.

    edges: int64 [n], numbers of the padded frame's pixels that are on depth edges.
    view: its frame and margin.
    reach: of a blur, in pixels.
    """
    columns = view.padded_shape[1]
    y, x = edges // columns - view.margin, edges % columns - view.margin
    found = []
    for top in range(0, view.height, TILE):
        for left in range(0, view.width, TILE):
            tile = Tile(top, left, min(TILE, view.height - top), min(TILE, view.width - left))
            near = (y >= top - reach) & (y < top + tile.height + reach)
            near &= (x >= left - reach) & (x < left + tile.width + reach)
            if bool(near.any()):
                found.append(tile)
    return found


def transform_pixels(height: int, width: int, reach: int) -> int:
    """Pixels of the transforms that blur such a part: with its surroundings, padded so that nothing wraps."""
    return (height + 4 * reach) * (width + 4 * reach)


def composite(view: View, blurring: Blurring, cut: list[float]) -> Tensor:
    """The whole padded frame composited in one go: [channel, y, x].

    cut: inverse depths between slabs.
    """
    slabs = slabs_of(view, cut)

    def blurred(which: Tensor) -> tuple[Tensor, Tensor]:
        shown = revealed(view, which)
        part = shown / view.coverage[which].clamp_min(torch.finfo(shown.dtype).tiny)
        return blurring.slab(view, which, part, shown)

    return merged((blurred(which) for which in reversed(slabs)), len(slabs))[0]


def merged(
    slabs: Iterable[tuple[Tensor, Tensor]], count: int, behind: Tensor | None = None
) -> tuple[Tensor, Tensor]:
    """Blurred light and coverage of `count` slabs, far to near, as one image; and what would be seen without
    the nearest of them: [channel, y, x] each.

    slabs: light and coverage, [channel, y, x] each.
    count: of the slabs.
    behind: what is seen where little is known behind the nearest slab, [channel, y, x]; None for light from
        around.
    """
    far_to_near = iter(slabs)
    image, blocked = next(far_to_near)
    coverage = blocked.clamp(0, 1)
    past = image
    for number, (light, blocked) in enumerate(far_to_near, 2):
        opaque = blocked.clamp(0, 1)
        # What rounding leaves where there is nothing must not be divided, slab after slab, by little
        there = torch.where(coverage > LITTLE, coverage, 1.0)
        bounded = number < count or behind is not None
        filled = (there / ENOUGH).clamp_max(1.0) if bounded else torch.ones_like(there)
        past = image * filled / there
        if number == count and behind is not None:
            past = past + (1 - coverage / ENOUGH).clamp_min(0.0) * behind
        image = light + (1 - opaque) * past
        coverage = opaque + (1 - opaque) * coverage * filled / there
    return image, past


def slabs_of(view: View, at: list[float]) -> list[Tensor]:
    """Fragments of each slab, near to far, int64 [n] each; `at`: where the view is cut, from near to far."""
    bounds = [float("inf"), *at, -1.0]
    depth = view.inverse_depth.double()
    inside = (
        torch.nonzero((depth <= near) & (depth > far)).squeeze(1)
        for near, far in zip(bounds, bounds[1:], strict=False)
    )
    return [which for which in inside if which.numel()]
