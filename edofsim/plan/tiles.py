"""Square tiles that stand for the frame of a view."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import pad

from ..capture.prepare import blur_per_dioptre
from ..optics import Camera
from ..render.view import View

PIXELS = 148_000
"""Pixels of all tiles: nine of them for the default PSFs. On whole frames of `desk`, `hallway`, `motorcycle`
and `stilllife` 97 % of estimates were then within 3 dB, with half of them 78 %; twice as many changed
nothing."""


@dataclass(frozen=True)
class Tiles:
    """Square tiles of a frame.

    side: in pixels.
    corners: (top, left) of each, some of which begin before the frame or end behind it.
    shares: [tile], float64: how many of the frame's tiles each stands for.
    taper: the window [tile, y, x] that the light of each is seen under. Squares of the windows of all tiles
        that a frame has sum to 1 at each of its pixels, so that a lamp counts alike wherever it lies.
    """

    height: int
    width: int
    side: int
    corners: tuple[tuple[int, int], ...]
    shares: Tensor
    taper: Tensor

    @cached_property
    def inside(self) -> Tensor:
        """1 where tiles are in the frame, else 0: [tile, y, x]."""
        along = torch.arange(self.side)
        rows, columns = (torch.tensor(at)[:, None] + along for at in zip(*self.corners, strict=True))
        in_rows = (rows >= 0) & (rows < self.height)
        in_columns = (columns >= 0) & (columns < self.width)
        return (in_rows[:, :, None] & in_columns[:, None]).to(torch.float32)

    @cached_property
    def scale(self) -> Tensor:
        """Of tiles in a vector, [tile, 1, 1]."""
        return (self.shares / (self.height * self.width)).sqrt().to(torch.float32)[:, None, None]

    def vector(self, change: Tensor) -> Tensor:
        """A change [tile, channel, y, x] as a vector [channel, n]: its sum of squares over n is the mean
        square of the change over the frame.

        change: [tile, channel, y, x].
        """
        return (change * (self.scale * self.inside)[:, None]).transpose(0, 1).flatten(1)

    def parts(self, longest: int) -> Iterator[tuple[int, slice, slice]]:
        """Of what lies in the frame of each tile, parts of no more than this many pixels a side: tile, rows
        and columns of it."""
        for tile, corner in enumerate(self.corners):
            sides = []
            for begin, length in zip(corner, (self.height, self.width), strict=True):
                low, high = max(0, -begin), min(self.side, length - begin)
                ends = torch.linspace(low, high, 1 + math.ceil((high - low) / longest)).round().int().tolist()
                sides.append([slice(*ends_of) for ends_of in pairwise(ends)])
            yield from ((tile, rows, columns) for rows in sides[0] for columns in sides[1])


def choose_tiles(view: View, ideal: Tensor, camera: Camera, side: int, seed: int = 0) -> Tiles:
    """Tiles of `side` pixels that stand for a view's frame.

    ideal: [channel, y, x] of it. Tiles with detail and depth edges are more likely to be among them, and
        count less each. All together they stand for as much detail as the frame has (a ratio estimate: what
        blur changes grows with it).
    """
    beyond = min(side // 4, view.margin)
    rows, columns = (_starts(length, side, beyond) for length in (view.height, view.width))
    down, across = _windows(rows, view.height, side), _windows(columns, view.width, side)
    windows = [(one, other) for one in down for other in across]
    places = [(y, x) for y in rows for x in columns]
    count = min(len(places), max(1, PIXELS // side**2))
    amounts = _amounts(view, ideal, camera, places, windows)
    chance = _chances(amounts, count)
    ends = np.cumsum(chance) * (count / chance.sum())  # rounding must not lose the last
    picked = np.searchsorted(ends, np.arange(count) + np.random.default_rng(seed).random())
    chosen = np.arange(count) if count == len(places) else np.unique(picked)
    shares = 1 / chance[chosen]
    pixels, detail, _ = amounts
    amount = detail if detail[chosen].any() else pixels
    shares *= amount.sum() / (shares @ amount[chosen])
    corners = tuple(places[tile] for tile in chosen)
    taper = torch.stack([torch.outer(*windows[tile]) for tile in chosen]).to(torch.float32)
    return Tiles(view.height, view.width, side, corners, torch.from_numpy(shares), taper)


def _starts(length: int, side: int, beyond: int) -> list[int]:
    """Where tiles begin that cover a frame's side and this many pixels on either side of it, each with a
    quarter or more of the next one in common."""
    whole = length + 2 * beyond
    if whole <= side:
        return [(length - side) // 2]
    count = 1 + -(-4 * (whole - side) // (3 * side))
    return [round(k * (whole - side) / (count - 1)) - beyond for k in range(count)]


def _windows(starts: Sequence[int], length: int, side: int) -> Tensor:
    """Along a frame's side, of each tile: float64 [tile, side]. They fall by cosines over a quarter at their
    ends (Tukey), over the root of what the squares of all sum to within the frame."""
    distance = (torch.arange(side, dtype=torch.float64) + 0.5 - side / 2).abs() / side
    window = 0.5 + 0.5 * torch.cos(4 * torch.pi * (distance - 0.25).clamp_min(0))
    at = torch.tensor(starts)[:, None] + torch.arange(side)
    within = (at >= 0) & (at < length)
    squares = torch.zeros(length, dtype=torch.float64)
    squares.index_add_(0, at[within], window.square().expand_as(at)[within])
    return window / squares[at.clamp(0, length - 1)].sqrt()


def _chances(amounts: np.ndarray, count: int) -> np.ndarray:
    """How likely each tile is to be one of `count`, by several amounts [amount, tile] alike: tiles that have
    most are chosen for certain, and others by what they have of the rest."""
    chosen = np.zeros(amounts.shape[1], bool)
    while True:
        rest = np.where(chosen, 0.0, amounts)
        shares = [part / part.sum() for part in rest if part.sum() > 0]
        chance = (count - chosen.sum()) * np.mean(shares, axis=0) if shares else np.zeros(len(chosen))
        if chance.max() < 1:
            return np.where(chosen, 1.0, chance)
        chosen[chance.argmax()] = True


def _amounts(
    view: View,
    ideal: Tensor,
    camera: Camera,
    places: Sequence[tuple[int, int]],
    windows: Sequence[tuple[Tensor, Tensor]],
) -> np.ndarray:
    """What tiles have of pixels, detail and depth edges, [3, tile]."""
    green = ideal.mean(0)
    detail = torch.zeros_like(green)
    detail[1:] += (green[1:] - green[:-1]).square()
    detail[:, 1:] += (green[:, 1:] - green[:, :-1]).square()
    depth = view.crop_margin(view.mean_inverse_depth()) * blur_per_dioptre(camera)
    edges = torch.zeros_like(green)
    edges[1:] += ((depth[1:] - depth[:-1]).abs() > 1).float()
    edges[:, 1:] += ((depth[:, 1:] - depth[:, :-1]).abs() > 1).float()
    side = windows[0][0].numel()
    found = [np.ones(len(places))]
    for amount in (detail, edges):
        around = pad(amount.double(), (side,) * 4)
        sums = [
            float(down.square() @ around[side + y :, side + x :][:side, :side] @ across.square())
            for (y, x), (down, across) in zip(places, windows, strict=True)
        ]
        found.append(np.array(sums))
    return np.stack(found)
