"""What changes at depth edges where each sub-aperture is composited by itself.

Where what hides and what is hidden are both blurred, light that passes an occluding edge fills only part of
the pupil, and is blurred otherwise than by the whole of it. The products of `hidden.compose` know averages
over the pupil alone. Composited through each sub-aperture (`optics.sub_aperture_psfs`) and added, the image
comes nearer to that of rays, the more sub-apertures the nearer. The light and the coverage of each slab are
transformed once for all of them, and their PSFs once for all slabs of a tile.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor
from torch.utils.checkpoint import checkpoint

from ...optics.threads import in_threads
from ...render.view import View
from ..blurring import Blurring
from ..coarse import CoarsePixels
from ..convolution import Grid, centred, mixed, spectrum, summed_products
from ..crop import crop
from ..kernels import Kernels
from ..light import light_of
from .hidden import merged, slabs_of, tiles_to_composite
from .slabs import cuts, hides, revealed

HELD_SHARE = 0.5
"""Least share of a sub-aperture's light, of that at the depth that its window holds most of it at, for which
its PSF may be normalised."""
LEAST_LIGHT = 1e-3
"""Of all light: sub-apertures of less hold nothing but the diffraction of others' borders."""


def change_by_sub_apertures(
    view: View, blurring: Blurring, through: Sequence[Kernels], side: int = 1
) -> Tensor:
    """[channel, y, x] of the padded frame: composited through each sub-aperture and added, minus composited
    through the whole pupil.

    blurring: through the whole pupil; through: its PSFs shared out, at the same nodes; side: of the pixels of
    all these PSFs, in pixels of the view: the change is interpolated between them. Gradients reach light and
    PSFs.
    """
    edges = torch.unique(view.pixel[hides(view, blurring.gap).front])
    change = view.radiance.new_zeros(len(blurring.response), *view.padded_shape)
    if not edges.numel():
        return change
    reach, pixels = side * blurring.reach, CoarsePixels(side)
    tiles = tiles_to_composite(edges, view, reach)
    if not tiles:
        return _change(view, blurring, through, pixels)
    m = view.margin
    for tile in tiles:
        around = crop(view, tile.top, tile.left, tile.height, tile.width, reach)
        rows = slice(m + tile.top, m + tile.top + tile.height)
        columns = slice(m + tile.left, m + tile.left + tile.width)
        change[:, rows, columns] = around.crop_margin(_change(around, blurring, through, pixels))
    return change


def _change(view: View, blurring: Blurring, through: Sequence[Kernels], pixels: CoarsePixels) -> Tensor:
    pupil = blurring.kernels
    grid = pixels.grid(*view.padded_shape, view.margin, pupil.window)
    slabs = []
    for which in slabs_of(view, cuts(view, blurring.gap)):
        shown = revealed(view, which)
        share = shown / view.coverage[which].clamp_min(torch.finfo(shown.dtype).tiny)
        shine = view.radiance.index_select(1, which) * share
        both = torch.cat([shine, shown[None]])
        light = pixels.light(light_of(view, pupil.nodes, which, both))
        slabs.append({node: spectrum(light.at_node(node), grid) for node in light.occupied_nodes()})
    used = sorted({node for slab in slabs for node in slab})
    response = blurring.response
    whole = Psfs(pupil, used, grid)
    change = -_composite(slabs, whole, whole.blocking(response), response, grid)

    def one(part: Kernels) -> Tensor:
        psfs = Psfs(part, used, grid)
        return _composite(slabs, psfs, psfs.blocking(response, whole, has_left(part)), response, grid)

    if change.requires_grad or any(part.layer(0).requires_grad for part in through):
        for part in through:  # one at a time is held, and computed again on the way back
            change = change + checkpoint(one, part, use_reentrant=False)
    else:
        at_once = max(1, torch.get_num_threads())
        for start in range(0, len(through), at_once):
            for image in in_threads(one, through[start : start + at_once], change.device):
                change = change + image
    return pixels.interpolated(centred(change, grid), *view.padded_shape)


class Psfs:
    """Sums [band] and spectra [band, ky, kx] of the PSFs at some depth nodes."""

    def __init__(self, kernels: Kernels, nodes: Sequence[int], grid: Grid) -> None:
        psfs = {node: kernels.layer(node) for node in nodes}
        self.sums = {node: psf.sum((-2, -1)) for node, psf in psfs.items()}
        self.spectra = {node: spectrum(psf, grid) for node, psf in psfs.items()}

    def blocking(
        self, response: Tensor, whole: Psfs | None = None, left: Tensor | None = None
    ) -> dict[int, Tensor]:
        """What `blurring.opaque_kernels` gives, as spectra [channel, ky, kx]; left: bool [node, band], where
        the whole pupil stands in."""
        found = {}
        for node, own in self.spectra.items():
            sums = self.sums[node]
            if whole is not None and left is not None and bool(left[node].any()):
                sums = torch.where(left[node], whole.sums[node], sums)
                own = torch.where(left[node][:, None, None], whole.spectra[node], own)
            found[node] = mixed(response / sums, own)
        return found


def _composite(
    slabs: Sequence[dict[int, Tensor]],
    psfs: Psfs,
    blocking: dict[int, Tensor],
    response: Tensor,
    grid: Grid,
) -> Tensor:
    """[channel, y, x], not yet `centred`. slabs: near to far, spectra of the light in each band and of the
    coverage, [band + 1, ky, kx], by depth node."""
    return merged((_blurred(slab, psfs, blocking, response, grid) for slab in reversed(slabs)), len(slabs))


def _blurred(
    slab: dict[int, Tensor], psfs: Psfs, blocking: dict[int, Tensor], response: Tensor, grid: Grid
) -> tuple[Tensor, Tensor]:
    """Light and coverage of a slab, [channel, y, x] each, not yet `centred`."""
    light = summed_products((given[:-1], psfs.spectra[node]) for node, given in slab.items())
    coverage = summed_products((given[-1:], blocking[node]) for node, given in slab.items())
    image, opaque = (
        torch.fft.irfft2(total, s=grid.transform) for total in (mixed(response, light), coverage)
    )
    return image, opaque


def has_left(kernels: Kernels) -> Tensor:
    """Where so much of the light through a sub-aperture lies outside the window that what is left of it does
    not tell what the sub-aperture is blocked by: bool [node, band]. The whole pupil stands in for it there.

    A blur that is wider than the window moves all light of an outer sub-aperture out of it. What stays is the
    diffraction of its border, of either sign, and must not be divided by its sum.
    """
    sums = torch.stack([kernels.layer(node).sum((-2, -1)) for node in range(kernels.nodes.numel())])
    most = sums.amax(0)
    return (sums < HELD_SHARE * most) | (most < LEAST_LIGHT)
