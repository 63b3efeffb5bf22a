"""Light to be blurred: fragments with their place between depth nodes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TypeVar

import torch
from torch import Tensor
from torch.nn.functional import pad

from ..render.view import View

CROP_BELOW = 0.8
"""Share of the frame from which on a part of it is not worth to be cut out."""


@dataclass(frozen=True)
class Placed:
    """Fragments in a frame.

    rows, columns: of the padded frame.
    pixel: int64 [fragment], row by row in it.
    """

    rows: int
    columns: int
    pixel: Tensor


P = TypeVar("P", bound=Placed)


@dataclass(frozen=True)
class Light(Placed):
    """Fragments, sorted by depth cell. Cell k lies between the depth nodes k and k + 1.

    share: [fragment] in [0, 1], hat weight of the cell's upper node (the lower one has the rest).
    radiance: [band, fragment].
    starts: cell k is fragments starts[k] to starts[k + 1].
    """

    share: Tensor
    radiance: Tensor
    starts: tuple[int, ...]

    @property
    def bands(self) -> int:
        return int(self.radiance.shape[0])

    def cells(self) -> list[tuple[int, slice]]:
        """The cells that hold fragments, with the range of these."""
        bounds = enumerate(zip(self.starts, self.starts[1:], strict=False))
        return [(cell, slice(begin, end)) for cell, (begin, end) in bounds if end > begin]

    def occupied_nodes(self) -> list[int]:
        """Nodes that some fragment has a share in, ascending."""
        found: set[int] = set()
        for cell, part in self.cells():
            share = self.share[part]
            if bool((share < 1).any()):
                found.add(cell)
            if bool(share.any()):
                found.add(cell + 1)
        return sorted(found)

    def at_node(self, node: int, bands: slice = slice(None)) -> Tensor:
        """Image of the light at one node: [band, y, x]."""
        image = self.radiance.new_zeros(self.radiance[bands].shape[0], self.rows * self.columns)
        for cell, rising in ((node - 1, True), (node, False)):
            if 0 <= cell < len(self.starts) - 1 and self.starts[cell + 1] > self.starts[cell]:
                part = slice(self.starts[cell], self.starts[cell + 1])
                weight = self.share[part] if rising else 1 - self.share[part]
                image.index_add_(1, self.pixel[part], self.radiance[bands, part] * weight)
        return image.reshape(-1, self.rows, self.columns)


@dataclass(frozen=True)
class SmoothLight(Placed):
    """Fragments whose light every depth node has a share in, which may be negative.

    shares: [node, fragment].
    radiance: [band, fragment].
    """

    shares: Tensor
    radiance: Tensor

    @property
    def bands(self) -> int:
        return int(self.radiance.shape[0])

    def occupied_nodes(self) -> list[int]:
        """All of them."""
        return list(range(len(self.shares)))

    def at_node(self, node: int, bands: slice = slice(None)) -> Tensor:
        """Image of the light at one node: [band, y, x]."""
        shine = self.radiance[bands] * self.shares[node]
        image = shine.new_zeros(len(shine), self.rows * self.columns).index_add_(1, self.pixel, shine)
        return image.reshape(-1, self.rows, self.columns)


@dataclass(frozen=True)
class Box:
    """Where a blur of `window` pixels carries light to, within a padded frame: rows from `top` on, columns
    from `left` on. May reach beyond the frame."""

    top: int
    left: int
    rows: int
    columns: int

    def light(self, light: P) -> P:
        """The same light in this part of the frame, which holds it."""
        y, x = light.pixel // light.columns - self.top, light.pixel % light.columns - self.left
        return replace(light, rows=self.rows, columns=self.columns, pixel=y * self.columns + x)

    def pasted(self, image: Tensor, rows: int, columns: int) -> Tensor:
        """An image [channel, y, x] of this part of a frame of rows and columns, as one of all of it.

        image: [channel, y, x].
        rows, columns: of the whole frame.
        """
        before = (self.left, columns - self.left - self.columns, self.top, rows - self.top - self.rows)
        return pad(image, before)


def box_of(light: Placed, window: int) -> Box | None:
    """The part of the frame that a blur carries light to; None where it is hardly smaller than the frame."""
    if not light.pixel.numel():
        return None
    half = window // 2
    sides = []
    y, x = light.pixel // light.columns, light.pixel % light.columns
    for place, length in ((y, light.rows), (x, light.columns)):
        first, last = (int(end) for end in place.aminmax())
        size = last - first + 1 + 2 * half
        sides.append((first - half, size) if size < length else (0, length))
    (top, rows), (left, columns) = sides
    return Box(top, left, rows, columns) if rows * columns < CROP_BELOW * light.rows * light.columns else None


def light_of(view: View, nodes: Tensor, which: Tensor, radiance: Tensor | None = None) -> Light:
    """Some of a view's fragments, between depth nodes.

    nodes: [node] inverse depths in 1/m, ascending; depths beyond them take the end node.
    which: int64 [n], the fragments that shine.
    radiance: [band, n], theirs (default: the view's).
    view: whose fragments they are.
    """
    rows, columns = view.padded_shape
    if nodes.numel() == 1:  # nothing lies between nodes: no order is needed
        shine, pixel = radiance, view.pixel[which]
        if shine is None:
            everything = which.numel() == view.pixel.numel()
            shine = view.radiance if everything else view.radiance.index_select(1, which)
        return Light(rows, columns, pixel, shine.new_zeros(pixel.numel()), shine, (0, pixel.numel()))
    cell, share = hat_weights(view.inverse_depth[which], nodes)
    order = torch.argsort(cell, stable=True)
    counts = torch.bincount(cell, minlength=max(1, nodes.numel() - 1))
    starts = (0, *torch.cumsum(counts, 0).tolist())
    ordered = which[order]
    # index_select is several times faster than indexing here
    shine = view.radiance.index_select(1, ordered) if radiance is None else radiance.index_select(1, order)
    return Light(rows, columns, view.pixel[ordered], share[order], shine, starts)


def seen(view: View) -> Tensor:
    """The fragments that are not hidden, int64 [n]."""
    return torch.nonzero(~view.hidden).squeeze(1)


def hat_weights(inverse_depth: Tensor, nodes: Tensor) -> tuple[Tensor, Tensor]:
    """Cell and share of the upper node of each inverse depth: linear interpolation between ascending nodes.

    inverse_depth: [fragment], 1/m.
    nodes: [node], 1/m, ascending.

    One node: cell 0 and share 0. Shares within 1e-6 of an end are moved onto it: a float32 depth that equals
    a node then costs one convolution, not two.
    """
    if nodes.numel() == 1:
        return torch.zeros_like(inverse_depth, dtype=torch.int64), torch.zeros_like(inverse_depth)
    exact = inverse_depth.double().contiguous()
    nodes = nodes.to(exact).contiguous()
    cell = (torch.searchsorted(nodes, exact, right=True) - 1).clamp(0, nodes.numel() - 2)
    share = ((exact - nodes[cell]) / (nodes[cell + 1] - nodes[cell])).clamp(0, 1).to(inverse_depth.dtype)
    share = torch.where(share < 1e-6, torch.zeros_like(share), share)
    return cell, torch.where(share > 1 - 1e-6, torch.ones_like(share), share)
