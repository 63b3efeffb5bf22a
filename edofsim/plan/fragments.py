"""Fragments of a view that lie in tiles, and images of their light at depth nodes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from ..render.view import View


@dataclass(frozen=True)
class Fragments:
    """n of them. which: int64 [n], their numbers in the view; place: int64 [n], the pixel of each, tile by
    tile; depth: float64 [n], inverse depths in 1/m at which they count."""

    which: Tensor
    place: Tensor
    depth: Tensor

    def __len__(self) -> int:
        return len(self.which)


def in_tiles(
    view: View, which: Tensor, at: Sequence[Tensor], corners: Sequence[tuple[int, int]], side: int
) -> list[Fragments]:
    """Those of the fragments `which` [n] of a view that lie in square tiles; for each of `at` once, fragments
    [n] at whose depth they count."""
    columns = view.padded_shape[1]
    pixel = view.pixel[which]
    row = torch.div(pixel, columns, rounding_mode="floor")
    y, x = ((each - view.margin).int() for each in (row, pixel - row * columns))
    found: list[Tensor] = []
    place: list[Tensor] = []
    for number, (top, left) in enumerate(corners):
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


def at_nodes(
    fragments: Fragments, light: Tensor, nodes: Tensor, tiles: int, side: int, shared: bool
) -> Tensor:
    """Images of light [k, n], each fragment's at the nearest of the nodes, where its PSF is that of a depth
    and no mixture; shared: at the two that it lies between. [tile, node, k, y, x]."""
    depth, place = fragments.depth, fragments.place
    size, count = side**2, nodes.numel()
    image = light.new_zeros(len(light), tiles * count * size)
    parts = [(nearest(depth, nodes), light)]
    if shared and count > 1:
        cell, upper = _cells(depth, nodes)
        upper = upper.to(light)
        parts = [(cell, light * (1 - upper)), (cell + 1, light * upper)]
    for node, part in parts:
        image.index_add_(1, (place // size * count + node) * size + place % size, part)
    return image.reshape(-1, tiles, count, side, side).permute(1, 2, 0, 3, 4)


def nearest(depth: Tensor, nodes: Tensor) -> Tensor:
    """The nearest node to each depth, as its number."""
    return torch.searchsorted((nodes[1:] + nodes[:-1]) / 2, depth)


def hat(fine: Tensor, nodes: Tensor, snapped: bool = False) -> Tensor:
    """How each fine depth is made of nodes, [fine, node]: by linear interpolation, or snapped to the
    nearest."""
    if nodes.numel() == 1:
        return torch.ones(fine.numel(), 1)
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
