"""Fragments of a view that lie in tiles, and images of their light at depth nodes, where there is any."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from ..render.view import View
from .tiles import Tiles

MEAN_SAMPLE = 20_000
"""Fragments that stand for all where only the mean of their light counts."""


@dataclass(frozen=True)
class Fragments:
    """n of them.

    which: int64 [n], their numbers in the view.
    place: int64 [n], the pixel of each, tile by tile.
    depth: float64 [n], inverse depths in 1/m at which they count.
    """

    which: Tensor
    place: Tensor
    depth: Tensor

    def __len__(self) -> int:
        return len(self.which)


@dataclass(frozen=True)
class Tiled:
    """Images of tiles at depth nodes, or their spectra, of those pairs of both where anything lies.

    values: [pair, k, y, x], or [pair, k, channel, y, x] where those of channels differ.
    tile, node: int64 [pair]. Nodes ascend, and so do the tiles of each.
    """

    values: Tensor
    tile: Tensor
    node: Tensor

    def transformed(self, windows: Tensor | None = None) -> Tiled:
        """Spectra of these images, under windows where these are given: values complex
        [pair, k, y, x // 2 + 1].

        windows: [tile, y, x]; None for none.
        """
        seen = self.values if windows is None else self.values * windows[self.tile][:, None]
        return replace(self, values=torch.fft.rfft2(seen))

    def part(self, begin: int, count: int) -> Tiled:
        """This many pairs from one on."""
        some = slice(begin, begin + count)
        return Tiled(self.values[some], self.tile[some], self.node[some])

    def of_tile(self, tile: int) -> Tiled:
        """The pairs of one tile."""
        some = self.tile == tile
        return Tiled(self.values[some], self.tile[some], self.node[some])

    def summed(self, weights: Tensor) -> tuple[Tensor, Tensor]:
        """The tiles that have pairs, int64 [some], and for each of them the sum over nodes and k of weights
        [node, channel, k, y, x] times values: [some, channel, y, x].

        weights: [node, channel, k, y, x].
        """
        tiles, place = self.tile.unique(return_inverse=True)
        found = self.values.new_zeros(len(tiles), weights.shape[1], *self.values.shape[-2:])
        values = self.values if self.values.ndim == 5 else self.values[:, :, None]
        begin = 0
        of_nodes = (each.tolist() for each in self.node.unique_consecutive(return_counts=True))
        for node, count in zip(*of_nodes, strict=True):
            some = slice(begin, begin + count)
            sums = found if count == len(tiles) else found[place[some]]
            for weight, value in zip(weights[node].unbind(1), values[some].unbind(1), strict=True):
                sums.addcmul_(weight, value)
            if sums is not found:
                found[place[some]] = sums
            begin += count
        return tiles, found


def in_tiles(view: View, which: Tensor, at: Sequence[Tensor], tiles: Tiles) -> list[Fragments]:
    """Those of the fragments `which` [n] of a view that lie in tiles; for each of `at` once, fragments [n] at
    whose depth they count.

    which: [n], numbers of fragments.
    at: [n] each, fragments at whose depth they count.
    """
    columns, side = view.padded_shape[1], tiles.side
    pixel = view.pixel[which]
    row = torch.div(pixel, columns, rounding_mode="floor")
    y, x = ((each - view.margin).int() for each in (row, pixel - row * columns))
    found: list[Tensor] = []
    place: list[Tensor] = []
    for number, (top, left) in enumerate(tiles.corners):
        inside = torch.nonzero((y >= top) & (y < top + side) & (x >= left) & (x < left + side)).squeeze(1)
        found.append(inside)
        place.append((number * side + y[inside].long() - top) * side + x[inside].long() - left)
    some, places = torch.cat(found), torch.cat(place)
    return [Fragments(which[some], places, view.inverse_depth[each[some]].double()) for each in at]


def together(*parts: Fragments) -> Fragments:
    """All of them, in this order."""
    return Fragments(
        *(torch.cat([getattr(part, name) for part in parts]) for name in ("which", "place", "depth"))
    )


def at_nodes(fragments: Fragments, light: Tensor, nodes: Tensor, tiles: Tiles, shared: bool) -> Tiled:
    """Images of light [k, n], each fragment's at the nearest of the nodes, where its PSF is that of a depth
    and no mixture.

    light: [k, n].
    nodes: [node], 1/m.
    shared: at the two that it lies between.
    """
    depth, side, count = fragments.depth, tiles.side, len(tiles.shares)
    size = side**2
    tile, within = fragments.place // size, fragments.place % size
    parts = [(nearest(depth, nodes), light)]
    if shared and nodes.numel() > 1:
        cell, upper = _cells(depth, nodes)
        upper = upper.to(light)
        parts = [(cell, light * (1 - upper)), (cell + 1, light * upper)]
    anything = torch.zeros(nodes.numel() * count, dtype=torch.bool)
    for node, _ in parts:
        anything[node * count + tile] = True
    if not anything.any():
        anything[0] = True  # Fourier transforms refuse no images at all
    pairs, number = torch.nonzero(anything).squeeze(1), anything.cumsum(0) - 1
    image = light.new_zeros(len(light), len(pairs) * size)
    for node, part in parts:
        image.index_add_(1, number[node * count + tile] * size + within, part)
    return Tiled(image.unflatten(1, (-1, side, side)).transpose(0, 1), pairs % count, pairs // count)


def light_by_depth(view: View, nodes: Tensor, reach: int) -> Tensor:
    """Light of the frame and `reach` pixels around it at the nearest of the nodes, a mean over these pixels,
    by some of its fragments: [band, node] float64.

    nodes: [node], 1/m.
    """
    reach = min(reach, view.margin)
    rows, columns, count = view.height + 2 * reach, view.width + 2 * reach, nodes.numel()
    step = max(1, view.pixel.numel() // MEAN_SAMPLE)
    pixel = view.pixel[::step]
    y = pixel // view.padded_shape[1] - (view.margin - reach)
    x = pixel % view.padded_shape[1] - (view.margin - reach)
    inside = (y >= 0) & (y < rows) & (x >= 0) & (x < columns) & ~view.hidden[::step]
    node = torch.where(inside, nearest(view.inverse_depth[::step].double(), nodes), count)
    amount = view.radiance.new_zeros(view.bands, count + 1)
    amount.index_add_(1, node, view.radiance[:, ::step])
    return amount[:, :count].double() * (step / (rows * columns))


def nearest(depth: Tensor, nodes: Tensor) -> Tensor:
    """The nearest node to each depth, as its number.

    depth: [n], 1/m.
    nodes: [node], 1/m.
    """
    return torch.searchsorted((nodes[1:] + nodes[:-1]) / 2, depth)


def hat(fine: Tensor, nodes: Tensor, snapped: bool = False) -> Tensor:
    """How each fine depth is made of nodes, [fine, node]: by linear interpolation, or snapped to the nearest.

    fine: [fine], 1/m.
    nodes: [node], 1/m.
    """
    if nodes.numel() == 1:
        return torch.ones(fine.numel(), 1, dtype=torch.float64)
    cell, share = _cells(fine, nodes)
    share = share.round() if snapped else share
    found = torch.zeros(fine.numel(), nodes.numel(), dtype=torch.float64)
    here = torch.arange(fine.numel())
    found[here, cell] += 1 - share
    found[here, cell + 1] += share
    return found


def _cells(depth: Tensor, nodes: Tensor) -> tuple[Tensor, Tensor]:
    """The node below each depth, as its number, and the share of the next."""
    cell = (torch.searchsorted(nodes, depth, right=True) - 1).clamp(0, nodes.numel() - 2)
    return cell, ((depth - nodes[cell]) / (nodes[cell + 1] - nodes[cell])).clamp(0, 1)
