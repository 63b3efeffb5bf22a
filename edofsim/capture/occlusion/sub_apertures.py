"""What changes at depth edges where each sub-aperture is composited by itself.

Where what hides and what is hidden are both blurred, light that passes an occluding edge fills only part of
the pupil, and is blurred otherwise than by the whole of it. The products of `hidden.compose` know averages
over the pupil alone. Composited through each sub-aperture (`optics.sub_aperture_psfs`) and added, the image
comes nearer to that of rays, the more sub-apertures the nearer. The light and the coverage of each slab are
transformed once for all of them.

PSFs of sub-apertures fall below 0 in places. Where one sees hardly anything behind the nearest slab, light
must not be divided by coverage: there it is taken to see what the whole pupil does.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import torch
from torch import Tensor
from torch.nn.functional import pad
from torch.utils.checkpoint import checkpoint

from ...core.threads import in_threads, threads_allowed
from ...optics import PsfField
from ...render.view import View
from ..blurring import Blurring
from ..coarse import CoarsePixels
from ..convolution import Grid, mixed, spectrum, summed_products
from ..crop import crop
from ..light import Box, Light, box_of, light_of
from .hidden import Layout, layout_of, merged, slabs_of
from .slabs import revealed

HELD_SHARE = 0.25
"""Least share of a sub-aperture's light, of that at the depth that its window holds most of it at, for which
its PSF may be normalised. Half of it would be too much: in `evaluate occlusion desk`, cubic mask, focus in
front, 34.7 dB in place of 38.2, and no case is better by it."""
LEAST_LIGHT = 1e-3
"""Of all light: sub-apertures of less hold nothing but the diffraction of others' borders."""
TINY = 1e-12


def change_by_sub_apertures(
    view: View,
    blurring: Blurring,
    through: Sequence[PsfField],
    side: int = 1,
    layout: Layout | None = None,
) -> Tensor:
    """[channel, y, x] of the padded frame, zero outside of the frame itself: composited through each
    sub-aperture and added, minus composited through the whole pupil.

    blurring: through the whole pupil.
    through: its PSFs shared out, at the same nodes.
    side: of the pixels of all these PSFs, in pixels of the view: the change is interpolated between them.
    layout: as of `compose`.

    Gradients reach light and PSFs.
    """
    reach, pixels = side * blurring.reach, CoarsePixels(side)
    layout = layout_of(view, blurring.gap, reach) if layout is None else layout
    change = view.radiance.new_zeros(len(blurring.response), *view.padded_shape)
    m = view.margin
    if layout.whole is not None:
        frame = slice(m, m + view.height), slice(m, m + view.width)
        change[:, *frame] = _change(view, blurring, through, pixels, layout.whole)
    for tile, cut in layout.tiles:
        around = crop(view, tile.top, tile.left, tile.height, tile.width, reach)
        rows = slice(m + tile.top, m + tile.top + tile.height)
        columns = slice(m + tile.left, m + tile.left + tile.width)
        change[:, rows, columns] = _change(around, blurring, through, pixels, cut)
    return change


def _change(
    view: View, blurring: Blurring, through: Sequence[PsfField], pixels: CoarsePixels, cut: list[float]
) -> Tensor:
    """[channel, y, x] of the frame."""
    pupil = blurring.psfs
    grid = pixels.grid(*view.padded_shape, view.margin, pupil.window)
    slabs = []
    for which in slabs_of(view, cut):
        shown = revealed(view, which)
        share = shown / view.coverage[which].clamp_min(torch.finfo(shown.dtype).tiny)
        shine = view.radiance.index_select(1, which) * share
        both = torch.cat([shine, shown[None]])
        light = pixels.light(light_of(view, pupil.inverse_depths, which, both))
        slabs.append(Slab.of(light, grid, None if pixels.side > 1 else (view.height, view.width)))

    image, past = _composite(slabs, spectra_of(pupil, pupil, blurring.response), blurring.response)
    change = -image
    of_all = _light_of(pupil, blurring.response).clamp_min(TINY)

    def one(part: PsfField) -> Tensor:
        spectra = spectra_of(part, pupil, blurring.response)
        behind = (_light_of(part, blurring.response) / of_all)[:, None, None] * past
        return _composite(slabs, spectra, blurring.response, behind)[0]

    if change.requires_grad or any(part.layer(0).requires_grad for part in through):
        for part in through:  # one at a time is held, and computed again on the way back
            change = change + checkpoint(one, part, use_reentrant=False)
    else:
        at_once = threads_allowed()
        for start in range(0, len(through), at_once):
            for image in in_threads(one, through[start : start + at_once], change.device):
                change = change + image
    return change if pixels.side == 1 else view.crop_margin(pixels.interpolated(change, *view.padded_shape))


@dataclass(frozen=True)
class Place:
    """Rows and columns, from `top` and `left` on, that are needed of images of a transform's size; and how
    many zeros, its `padding`, lie around them, beyond the blur: to the left and right, above and below."""

    grid: Grid
    top: int
    left: int
    rows: int
    columns: int
    padding: tuple[int, int, int, int] = (0, 0, 0, 0)

    def image(self, spectra: Tensor) -> Tensor:
        """[channel, ky, kx] to [channel, y, x] of the place.

        spectra: [channel, ky, kx].
        """
        if not self.rows or not self.columns:
            return pad(spectra.real.new_zeros(len(spectra), self.rows, self.columns), self.padding)
        rows, columns = self.grid.transform
        lines = torch.fft.ifft(spectra, dim=-2)
        there = _around(lines, self.top, self.rows, rows, -2)
        image = _around(torch.fft.irfft(there, n=columns), self.left, self.columns, columns, -1)
        return pad(image, self.padding) if any(self.padding) else image


@dataclass(frozen=True)
class Slab:
    """The light of a slab in each band, and what it covers, [band + 1, ky, kx], by depth node; and where its
    blurred images are needed."""

    spectra: dict[int, Tensor]
    place: Place

    @classmethod
    def of(cls, light: Light, grid: Grid, frame: tuple[int, int] | None) -> Slab:
        """Transformed in the part of the padded frame that its blur reaches.

        grid: of all of that.
        frame: the rows and columns within its margin that are needed, None for all of it, to be interpolated
            between.
        """
        inset = grid.margin if frame else 0
        rows, columns = frame or (grid.rows, grid.columns)
        box = box_of(light, grid.window) or Box(0, 0, grid.rows, grid.columns)
        whole = (box.rows, box.columns) == (grid.rows, grid.columns)
        margin = grid.margin if whole else min(grid.margin, grid.window // 2)
        within = Grid(box.rows, box.columns, margin, grid.window)
        top, above, high = _met(box.top, box.rows, inset, rows)
        left, before, wide = _met(box.left, box.columns, inset, columns)
        padding = (before, columns - before - wide, above, rows - above - high)
        centre = grid.window // 2
        here = box.light(light)
        return cls(
            {node: spectrum(here.at_node(node), within) for node in here.occupied_nodes()},
            Place(within, centre + top, centre + left, high, wide, padding),
        )


def _met(first: int, count: int, begin: int, needed: int) -> tuple[int, int, int]:
    """Where `count` places from `first` on meet `needed` ones from `begin` on: the first of them in those and
    in these, and how many they are."""
    start, end = max(first, begin), min(first + count, begin + needed)
    return min(start - first, count), min(start - begin, needed), max(0, end - start)


def _around(image: Tensor, begin: int, count: int, period: int, axis: int) -> Tensor:
    """This many of an axis from `begin` on, which goes on at its beginning behind its end."""
    if begin + count <= period:
        return image.narrow(axis, begin, count)
    return torch.roll(image, -begin, axis).narrow(axis, 0, count)


Spectra: TypeAlias = Callable[[Iterable[int], Grid], dict[int, tuple[Tensor, Tensor]]]
"""PSFs at nodes as spectra of a grid, by node: [band, ky, kx] for light, and [channel, ky, kx] for coverage,
as PSFs of white light that each sum to 1."""


def spectra_of(part: PsfField, pupil: PsfField, response: Tensor) -> Spectra:
    """Those of a part of the pupil. Those asked for last are kept: all at once would be more memory than
    stays near a processor.

    response: [channel, band].
    part, pupil: PSFs by the sub-aperture, and by all of the pupil.
    """
    left = torch.zeros(()) if part is pupil else has_left(part)
    known: dict[tuple[int, Grid], tuple[Tensor, Tensor]] = {}

    def made(node: int, grid: Grid) -> tuple[Tensor, Tensor]:
        psf = part.layer(node)
        through = spectrum(psf, grid)
        if left.ndim and bool(left[node].any()):
            psf = torch.where(left[node][:, None, None], pupil.layer(node), psf)
            return through, mixed(response / psf.sum((-2, -1)), spectrum(psf, grid))
        return through, mixed(response / psf.sum((-2, -1)), through)

    def at(nodes: Iterable[int], grid: Grid) -> dict[int, tuple[Tensor, Tensor]]:
        nonlocal known
        known = {(node, grid): known.get((node, grid)) or made(node, grid) for node in nodes}
        return {node: found for (node, _), found in known.items()}

    return at


def _light_of(part: PsfField, response: Tensor) -> Tensor:
    """How much a channel sees of white light, a mean over depths: [channel]."""
    return response @ part.values.sum((-2, -1)).mean(0)


def _composite(
    slabs: Sequence[Slab], psfs: Spectra, response: Tensor, behind: Tensor | None = None
) -> tuple[Tensor, Tensor]:
    """As `merged` has them, of the place that is needed, without the light of the nearest slab: nothing hides
    that, and it adds up to the same through all parts of the pupil. slabs: near to far."""

    def blurred(slab: Slab) -> tuple[Tensor, Tensor]:
        spectra, place = slab.spectra, slab.place
        through = psfs(spectra, place.grid)
        opaque = place.image(summed_products((spectra[node][-1:], through[node][1]) for node in spectra))
        if slab is slabs[0]:
            return torch.zeros_like(opaque), opaque
        light = summed_products((spectra[node][:-1], through[node][0]) for node in spectra)
        return place.image(mixed(response, light)), opaque

    return merged((blurred(slab) for slab in reversed(slabs)), len(slabs), behind)


def has_left(part: PsfField) -> Tensor:
    """Where so much of the light through a sub-aperture lies outside the window that what is left of it does
    not tell what the sub-aperture is blocked by: bool [node, band]. The whole pupil stands in for it there.

    A blur that is wider than the window moves all light of an outer sub-aperture out of it. What stays is the
    diffraction of its border, of either sign, and must not be divided by its sum.
    """
    sums = part.values.sum((-2, -1))
    most = sums.amax(0)
    return (sums < HELD_SHARE * most) | (most < LEAST_LIGHT)
