"""Blurring by PSFs of the place in the field, as sums of a few kernels."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property

import torch
from torch import Tensor
from torch.nn.functional import embedding_bag

from ..optics import PsfField
from ..optics.band_limited import band_limited_weights
from ..optics.contrast import CONTRAST_DB
from ..optics.terms import HALF, Terms, cubic
from ..render.view import View
from .band_limit import BandLimit
from .blurring import Blurring
from .convolution import Grid, image_of, spectrum
from .light import Placed, hat_weights
from .prepare import DEFOCUS_STEP

AT_ONCE = 1 << 14
"""Fragments whose factors are looked up together."""
MOST_ROWS = 3000
"""PSFs that are looked at to find kernels that make up all."""
NEARER_DB = 10.0
"""Than is asked for: depths between which light is shared are cheap here."""
BLOCK_PIXELS = 1 << 22
"""Pixels of all images that are transformed together."""


@dataclass(frozen=True)
class TermLight(Placed):
    """Light for each kernel.

    amounts: [channel, term, fragment].
    kernels: [term, y, x].
    """

    amounts: Tensor
    kernels: Tensor


@dataclass(frozen=True)
class _Table:
    """Factors at a grid of places and depths, and where fragments are between these. factors: [row, group,
    term]; held: [row, group], the light that they bring; corners, shares: [fragment, corner], rows of a
    fragment, their weights; kernels: [term, y, x]."""

    factors: Tensor
    held: Tensor
    corners: Tensor
    shares: Tensor
    kernels: Tensor

    @cached_property
    def cells(self) -> tuple[Tensor, list[Tensor]]:
        """Fragments in the order of their rows, and in parts of no more than `AT_ONCE` with the same ones."""
        order = self.corners[:, 0].argsort(stable=True)
        counts = self.corners[order, 0].unique_consecutive(return_counts=True)[1].tolist()
        return order, [part for cell in order.split(counts) for part in cell.split(AT_ONCE)]

    def weighted(self, values: Tensor) -> Iterator[Tensor]:
        """Of values [row, n], those of each fragment, some fragments at a time: [n of fragment, n]."""
        for at, by in zip(self.corners.split(AT_ONCE), self.shares.split(AT_ONCE), strict=True):
            yield embedding_bag(at, values, mode="sum", per_sample_weights=by)


class TermBlurring(Blurring):
    """`Blurring` for a lens that varies over the field.

    terms: of all depth nodes and groups of bands; step: pixels between places where straight lines between
    them are true enough; db: PSNR that depths keep which light is shared by. Other parameters as there; psfs:
    of the axis.
    """

    def __init__(
        self,
        psfs: PsfField,
        response: Tensor,
        gap: float,
        between: BandLimit | None,
        terms: Terms,
        step: float,
        db: float,
    ) -> None:
        super().__init__(psfs, response, gap, between)
        self._terms, self._db = terms, db
        self._parts = max(1, math.ceil(terms.step / step - 1e-9))
        # what straight lines between places leave out, by second differences of what they go between
        size = terms.factors.shape
        bent = [terms.factors.diff(2, axis).square().sum(-1).mean() for axis in (0, 1) if size[axis] > 2]
        straight = float(sum(bent)) / (8 * self._parts**2) ** 2
        self._allowed = max(straight, HALF**2 * 10 ** ((CONTRAST_DB - db) / 10))
        self._factors, self._kernels = self._fewer(terms.factors, terms.kernels)

    def light(self, view: View, which: Tensor, part: Tensor | None = None) -> Tensor:
        radiance = view.radiance.index_select(1, which)
        radiance = radiance if part is None else radiance * part
        return self._shone(self._table(view, which), view, which, radiance)

    def coverage(self, view: View, which: Tensor, amount: Tensor) -> Tensor:
        return self._covered(self._table(view, which), view, which, amount)

    def slab(self, view: View, which: Tensor, part: Tensor, amount: Tensor) -> tuple[Tensor, Tensor]:
        table = self._table(view, which)
        radiance = view.radiance.index_select(1, which) * part
        return self._shone(table, view, which, radiance), self._covered(table, view, which, amount)

    def lost(self, view: View, which: Tensor) -> Tensor:
        """Light of fragments that lands outside of the PSFs' windows, [channel].

        which: int64 [n], the fragments.
        view: whose fragments they are.
        """
        table, total = self._table(view, which, self._terms.lost[..., None]), 0.0
        pieces = zip(table.weighted(table.factors.flatten(1)), which.split(AT_ONCE), strict=True)
        for beyond, some in pieces:
            total = total + (beyond.T * view.radiance.index_select(1, some)).sum(1)
        return self.response @ torch.as_tensor(total, dtype=self.response.dtype)

    def _shone(self, table: _Table, view: View, which: Tensor, radiance: Tensor) -> Tensor:
        def shone(some: Tensor, shares: Tensor, corners: Tensor) -> Tensor:
            light = radiance.index_select(1, some) * self.response[:, :, None]
            light = (light[:, None] * shares[:, None]).flatten(1, 2)  # [channel, corner * group, n]
            return table.factors[corners].flatten(0, 1).T @ light

        return self._imaged(table, view, which, shone)

    def _covered(self, table: _Table, view: View, which: Tensor, amount: Tensor) -> Tensor:
        """By PSFs that each sum to 1, but where they crowd light or spread it: a wall covers all."""
        white = torch.einsum("cg,ngt->nct", self.response, table.factors / table.held[..., None])

        def covered(some: Tensor, shares: Tensor, corners: Tensor) -> Tensor:
            rows = white[corners]
            return (rows.flatten(1).T @ (shares * amount[some])).unflatten(0, rows.shape[1:])

        return self._imaged(table, view, which, covered)

    def _imaged(
        self,
        table: _Table,
        view: View,
        which: Tensor,
        amounts: Callable[[Tensor, Tensor, Tensor], Tensor],
    ) -> Tensor:
        """Blurred, what there is of each kernel. `amounts` gives it, [channel, term, n], of some fragments
        [n] between the same rows, by their weights [corner, n] and these rows [corner]."""
        if not len(which):
            return self.response.new_zeros(len(self.response), *view.padded_shape)
        order, parts = table.cells
        size = len(self.response), len(table.kernels), len(which)
        found, start = table.kernels.new_empty(size), 0
        for some in parts:
            inside = slice(start, start := start + len(some))
            found[..., inside] = amounts(some, table.shares[some].T, table.corners[some[0]])
        light = TermLight(*view.padded_shape, view.pixel[which[order]], found, table.kernels)
        return self._blurred(blurred_terms, light, view)

    def _table(self, view: View, which: Tensor, values: Tensor | None = None) -> _Table:
        """Of fragments [n]; values: [down, across, node, group, n] in place of the terms' factors."""
        terms, pixel, columns = self._terms, view.pixel[which], view.padded_shape[1]
        factors = self._factors if values is None else values
        corners, shares = torch.zeros_like(pixel)[:, None], view.radiance.new_ones(len(pixel), 1)
        sides = []
        for at, axis, first, count in zip(
            (pixel // columns, pixel % columns), view.axis_px, terms.first, factors.shape[:2], strict=True
        ):
            place = (at.double() - view.margin + 0.5 - axis) / terms.step - first
            ticks, cell, share = self._ticks(place)
            sides.append(cubic(ticks, count))
            corners, shares = _doubled(corners, shares, cell, share, len(ticks))
        depths, weights = self._depths(view.inverse_depth[which])
        cell, share = hat_weights(view.inverse_depth[which], depths)
        corners, shares = _doubled(corners, shares, cell, share, len(depths))
        down, across = (side.to(factors) for side in sides)
        used = [torch.nonzero(side.abs().sum(0)).flatten() for side in (down, across)]

        def at_depths(values: Tensor) -> Tensor:
            values = values.index_select(0, used[0]).index_select(1, used[1])
            return torch.einsum("dn,yxngt->yxdgt", weights.to(values), values)

        def at_places(values: Tensor) -> Tensor:
            values = torch.tensordot(down[:, used[0]], values, 1)
            values = torch.tensordot(across[:, used[1]], values.transpose(0, 1), 1).transpose(0, 1)
            return values.flatten(0, 2).contiguous()

        factors, kernels = at_depths(factors), self._kernels
        if values is None:
            factors, kernels = self._fewer(factors, kernels)
        held = at_places(at_depths(terms.held[..., None]))[..., 0]
        return _Table(at_places(factors), held, corners, shares, kernels)

    def _ticks(self, place: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Steps that straight lines go through which hold places [n]; the one before each, and the share of
        the one after it."""
        if not place.numel():
            return place.new_zeros(1), place.long(), place
        fine = place * self._parts
        low, high = math.floor(float(fine.min())), math.floor(float(fine.max())) + 1
        ticks = torch.arange(low, high + 1, dtype=torch.float64) / self._parts
        cell = (fine - low).floor().long()
        return ticks, cell, fine - low - cell

    def _depths(self, inverse_depth: Tensor) -> tuple[Tensor, Tensor]:
        """Inverse depths [depth] that light is shared by, and the weights [depth, node] of the PSFs'."""
        nodes = self.psfs.inverse_depths.double().cpu()
        low, high = (float(end) for end in inverse_depth.aminmax()) if inverse_depth.numel() else (0.0, 0.0)
        if self.between is None:
            first = max(0, int(torch.searchsorted(nodes, low, right=True)) - 1)
            last = min(len(nodes), int(torch.searchsorted(nodes, high)) + 1)
            some = torch.arange(first, max(last, first + 1))
            return nodes[some], torch.eye(len(nodes), dtype=torch.float64)[some]
        step = DEFOCUS_STEP * 10 ** ((50 - self._db - NEARER_DB) / 40)
        count = 2 + math.floor((high - low) * self.between.per_dioptre / step) if high > low else 1
        depths = torch.linspace(low, high, count, dtype=torch.float64)
        return depths, band_limited_weights(depths, nodes, self.between.per_dioptre)

    def _fewer(self, factors: Tensor, kernels: Tensor) -> tuple[Tensor, Tensor]:
        """Sums of the kernels, as few as make up PSFs that are known to within what straight lines between
        places leave out, or what was allowed when they were found."""
        rows = factors.flatten(0, -2)
        some = torch.randperm(len(rows), generator=torch.Generator().manual_seed(0))[:MOST_ROWS]
        rows = rows[some].double()
        values, vectors = torch.linalg.eigh(rows.T @ rows)
        many = int((values.cumsum(0) > self._allowed * len(rows)).sum().clamp_min(1))
        main = vectors[:, -many:].to(factors)
        return factors @ main, torch.tensordot(main.T, kernels, 1)


def _doubled(
    corners: Tensor, shares: Tensor, cell: Tensor, share: Tensor, count: int
) -> tuple[Tensor, Tensor]:
    """Corners of cells [n, corner] with one axis more, of `count` places: before and after each fragment."""
    share = share.to(shares)[:, None]
    if count == 1:
        return corners, shares
    corners = corners * count + cell[:, None]
    return torch.cat([corners, corners + 1], 1), torch.cat([shares * (1 - share), shares * share], 1)


def blurred_terms(light: TermLight, grid: Grid) -> Tensor:
    """The image [channel, y, x] of light in the padded frame of a grid."""
    channels, terms = light.amounts.shape[:2]
    block = max(1, BLOCK_PIXELS // (channels * math.prod(grid.transform)))
    row = torch.div(light.pixel, light.columns, rounding_mode="floor")
    place = light.pixel + row * (grid.transform[1] - light.columns)
    total = None
    for start in range(0, terms, block):
        some = light.amounts[:, start : start + block].flatten(0, 1)
        # at once where it is transformed: that takes half as long as to widen and turn images
        image = some.new_zeros(len(some), math.prod(grid.transform)).index_add_(1, place, some)
        shine = spectrum(image.reshape(channels, -1, *grid.transform), grid).unbind(1)
        through = spectrum(light.kernels[start : start + block], grid)
        # one after the other: a product of all is written and read once more
        for one, kernel in zip(shine, through, strict=True):
            total = one * kernel if total is None else total.addcmul_(one, kernel)
    assert total is not None  # there is one term at least
    return image_of(total, grid)
