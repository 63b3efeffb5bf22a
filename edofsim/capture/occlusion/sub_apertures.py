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

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
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
SMALL_FRAME = 1 << 15
"""Pixels of the transforms of frames that are small: their slabs are transformed together, in fewer calls. In
larger ones that takes longer, as each slab then has a part of the frame of its own."""


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
    lights = []
    for which in slabs_of(view, cut):
        shown = revealed(view, which)
        share = shown / view.coverage[which].clamp_min(torch.finfo(shown.dtype).tiny)
        shine = view.radiance.index_select(1, which) * share
        both = torch.cat([shine, shown[None]])
        lights.append(pixels.light(light_of(view, pupil.inverse_depths, which, both)))
    stacks = in_stacks(lights, grid, None if pixels.side > 1 else (view.height, view.width))

    image, past = _composite(stacks, spectra_of(pupil, pupil, blurring.response), blurring.response)
    change = -image
    of_all = _light_of(pupil, blurring.response).clamp_min(TINY)

    def one(part: PsfField) -> Tensor:
        spectra = spectra_of(part, pupil, blurring.response)
        behind = (_light_of(part, blurring.response) / of_all)[:, None, None] * past
        return _composite(stacks, spectra, blurring.response, behind)[0]

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
class Slabs:
    """Some slabs, near to far, and where their blurred images are needed.

    spectra: the light in each band, and what is covered, by depth node: the first of the slabs that have
        light there, and [slab, band + 1, ky, kx] from it on.
    """

    count: int
    spectra: dict[int, tuple[int, Tensor]]
    place: Place

    @classmethod
    def of(cls, lights: Sequence[Light], grid: Grid, frame: tuple[int, int] | None) -> Slabs:
        """Transformed in the part of the padded frame that the blur of the one reaches, in all of it for
        several.

        lights: of each slab.
        grid: of all of the padded frame.
        frame: the rows and columns within its margin that are needed, None for all of it, to be interpolated
            between.
        """
        inset = grid.margin if frame else 0
        rows, columns = frame or (grid.rows, grid.columns)
        everywhere = Box(0, 0, grid.rows, grid.columns)
        box = everywhere if len(lights) > 1 else box_of(lights[0], grid.window) or everywhere
        whole = (box.rows, box.columns) == (grid.rows, grid.columns)
        margin = grid.margin if whole else min(grid.margin, grid.window // 2)
        within = Grid(box.rows, box.columns, margin, grid.window)
        top, above, high = _met(box.top, box.rows, inset, rows)
        left, before, wide = _met(box.left, box.columns, inset, columns)
        padding = (before, columns - before - wide, above, rows - above - high)
        centre = grid.window // 2
        spectra: dict[int, tuple[int, Tensor]] = {}
        here = [box.light(light) for light in lights]
        occupied = [set(light.occupied_nodes()) for light in here]
        for node in sorted(set().union(*occupied)):
            there = [number for number, nodes in enumerate(occupied) if node in nodes]
            images = torch.stack([here[k].at_node(node) for k in range(there[0], there[-1] + 1)])
            spectra[node] = there[0], spectrum(images, within)
        return cls(len(lights), spectra, Place(within, centre + top, centre + left, high, wide, padding))

    def blurred(self, psfs: dict[int, tuple[Tensor, Tensor]], response: Tensor) -> tuple[Tensor, Tensor]:
        """The images of light and coverage, [slab, channel, y, x] each.

        psfs: of each node, [band, ky, kx] and [channel, ky, kx], as of `Spectra`.
        response: [channel, band].
        """
        light = mixed(response, self._summed(psfs, slice(None, -1), 0))
        return self._images(light), self.covers(psfs)

    def covers(self, psfs: dict[int, tuple[Tensor, Tensor]]) -> Tensor:
        """The images of coverage alone, [slab, channel, y, x].

        psfs: of each node, [band, ky, kx] and [channel, ky, kx].
        """
        return self._images(self._summed(psfs, slice(-1, None), 1))

    def _images(self, spectra: Tensor) -> Tensor:
        return self.place.image(spectra.flatten(0, 1)).unflatten(0, (self.count, -1))

    def _summed(self, psfs: dict[int, tuple[Tensor, Tensor]], bands: slice, which: int) -> Tensor:
        """Over nodes, [slab, band, ky, kx]; which: of the two PSFs of a node."""
        pairs = [
            (first, own[:, bands], psfs[node][which][None]) for node, (first, own) in self.spectra.items()
        ]
        if self.count == 1:
            return summed_products((own, psf) for _, own, psf in pairs)
        _, own, psf = pairs[0]
        total = own.new_zeros(self.count, *psf.shape[1:])
        for first, own, psf in pairs:
            total[first : first + len(own)].addcmul_(own, psf)
        return total


def in_stacks(lights: Sequence[Light], grid: Grid, frame: tuple[int, int] | None) -> list[Slabs]:
    """Slabs, near to far, in one stack where the frame is small, and else each by itself.

    lights, grid, frame: as of `Slabs.of`.
    """
    together = len(lights) if math.prod(grid.transform) <= SMALL_FRAME else 1
    return [Slabs.of(lights[k : k + together], grid, frame) for k in range(0, len(lights), together)]


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
    stacks: Sequence[Slabs], psfs: Spectra, response: Tensor, behind: Tensor | None = None
) -> tuple[Tensor, Tensor]:
    """As `merged` has them, of the place that is needed, without the light of the nearest slab: nothing hides
    that, and it adds up to the same through all parts of the pupil. stacks: near to far."""

    def blurred() -> Iterator[tuple[Tensor, Tensor]]:
        for stack in reversed(stacks):
            through = psfs(stack.spectra, stack.place.grid)
            if stack is stacks[0] and stack.count == 1:
                opaque = stack.covers(through)
                light = torch.zeros_like(opaque)
            else:
                light, opaque = stack.blurred(through, response)
            for k in reversed(range(stack.count)):
                nearest = stack is stacks[0] and k == 0
                yield torch.zeros_like(light[k]) if nearest else light[k], opaque[k]

    return merged(blurred(), sum(stack.count for stack in stacks), behind)


def has_left(part: PsfField) -> Tensor:
    """Where so much of the light through a sub-aperture lies outside the window that what is left of it does
    not tell what the sub-aperture is blocked by: bool [node, band]. The whole pupil stands in for it there.

    A blur that is wider than the window moves all light of an outer sub-aperture out of it. What stays is the
    diffraction of its border, of either sign, and must not be divided by its sum.
    """
    sums = part.values.sum((-2, -1))
    most = sums.amax(0)
    return (sums < HELD_SHARE * most) | (most < LEAST_LIGHT)
