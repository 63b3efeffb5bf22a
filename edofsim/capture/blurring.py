"""What occlusion is built from: the blurred light, and the blurred coverage, of any choice of fragments."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cached_property

import torch
from torch import Tensor

from ..optics import PsfField
from ..render.view import View
from .band_limit import BandLimit
from .convolution import Grid
from .layers import Blur, layered
from .light import P, SmoothLight, box_of, light_of


class Blurring:
    """A camera's PSFs and its response, ready to blur fragments on frames of any size.

    psfs: at depth nodes.
    response: [channel, band].
    gap: difference in inverse depth below which two surfaces are one, in 1/m: their blurs differ by less than
        a pixel.
    between: how light between the nodes is blurred, None: it is shared by the two next to it.
    """

    def __init__(
        self,
        psfs: PsfField,
        response: Tensor,
        gap: float = 0.0,
        between: BandLimit | None = None,
    ) -> None:
        self.psfs = psfs
        self.response = response
        self.gap = gap
        self.between = between

    @property
    def reach(self) -> int:
        """How far a PSF carries light, in pixels."""
        return self.psfs.window // 2

    @cached_property
    def _shines(self) -> Blur:
        """A blur of light at the nodes."""
        return layered(self.psfs, self.response)

    @cached_property
    def _blocks(self) -> Blur:
        """A blur of coverage there."""
        return self._blocking(self.psfs)

    def light(self, view: View, which: Tensor, part: Tensor | None = None) -> Tensor:
        """Blurred light of some fragments: [channel, y, x] of the padded frame.

        which: int64 [n].
        part: [n], the fraction of each fragment's light (default: all).
        view: whose fragments they are.
        """
        radiance = None if part is None else view.radiance.index_select(1, which) * part
        if self.between is not None:
            return self._smooth_light(self._nearby(view, which), view, which, radiance)
        return self._blurred(self._shines, light_of(view, self.psfs.inverse_depths, which, radiance), view)

    def coverage(self, view: View, which: Tensor, amount: Tensor) -> Tensor:
        """How much some fragments block of what lies behind them: [channel, y, x] of the padded frame.

        which: int64 [n].
        amount: [n], the coverage of each. It is blurred with the PSFs of each band and weighted by the
            response, as white light is.
        view: whose fragments they are.

        An opaque surface blocks everything though part of its light may leave the PSFs' windows: these PSFs
        sum to 1.
        """
        if self.between is not None:
            return self._smooth_coverage(self._nearby(view, which), view, which, amount)
        light = light_of(view, self.psfs.inverse_depths, which, amount[None])
        return self._blurred(self._blocks, light, view)

    def slab(self, view: View, which: Tensor, part: Tensor, amount: Tensor) -> tuple[Tensor, Tensor]:
        """`light` and `coverage` of the same fragments.

        which: [fragment], numbers of fragments of the view.
        part: [fragment], share of each that counts.
        amount: [fragment], coverage of each.
        view: whose fragments they are.
        """
        if self.between is None:
            both = torch.cat([view.radiance.index_select(1, which) * part, amount[None]])
            placed = light_of(view, self.psfs.inverse_depths, which, both)
            shining = replace(placed, radiance=placed.radiance[:-1])
            blocking = replace(placed, radiance=placed.radiance[-1:])
            return self._blurred(self._shines, shining, view), self._blurred(self._blocks, blocking, view)
        near = self._nearby(view, which)
        radiance = view.radiance.index_select(1, which) * part
        return (
            self._smooth_light(near, view, which, radiance),
            self._smooth_coverage(near, view, which, amount),
        )

    def _nearby(self, view: View, which: Tensor) -> tuple[PsfField, Tensor]:
        """PSFs at nodes that suit these fragments' depths, and the shares [node, n] of each in them."""
        assert self.between is not None
        depth = view.inverse_depth[which]
        nodes = self.between.nodes(depth)
        return self.psfs.at(nodes, self.between.per_dioptre), self.between.shares(depth, nodes)

    def _smooth_light(
        self, near: tuple[PsfField, Tensor], view: View, which: Tensor, radiance: Tensor | None
    ) -> Tensor:
        shine = view.radiance.index_select(1, which) if radiance is None else radiance
        light = SmoothLight(*view.padded_shape, view.pixel[which], near[1], shine)
        return self._blurred(layered(near[0], self.response), light, view)

    def _smooth_coverage(
        self, near: tuple[PsfField, Tensor], view: View, which: Tensor, amount: Tensor
    ) -> Tensor:
        light = SmoothLight(*view.padded_shape, view.pixel[which], near[1], amount[None])
        return self._blurred(self._blocking(near[0]), light, view)

    def _blocking(self, psfs: PsfField) -> Blur:
        one_each = torch.eye(len(self.response), dtype=self.response.dtype, device=self.response.device)
        return layered(white_psfs(psfs, self.response), one_each)

    def _blurred(self, blur: Callable[[P, Grid], Tensor], light: P, view: View) -> Tensor:
        """Blurred in the part of the frame that holds the light's blur."""
        window, shape = self.psfs.window, view.padded_shape
        box = box_of(light, window)
        if box is None:
            return blur(light, Grid(*shape, view.margin, window))
        image = blur(box.light(light), Grid(box.rows, box.columns, min(view.margin, window // 2), window))
        return box.pasted(image, *shape)


def white_psfs(psfs: PsfField, response: Tensor) -> PsfField:
    """PSFs of white light in each channel, each summing to 1: [depth, channel, y, x] in the band's place.

    response: [channel, band].
    psfs: [depth, band, y, x].
    """
    layers = []
    for node in range(psfs.inverse_depths.numel()):
        psf = psfs.layer(node)
        layers.append(torch.einsum("cb,byx->cyx", response, psf / psf.sum((-2, -1), keepdim=True)))
    colours = (response @ psfs.wavelengths.to(response)) / response.sum(1)
    return PsfField(torch.stack(layers), psfs.inverse_depths, colours)
