"""What occlusion is built from: the blurred light, and the blurred coverage, of any choice of fragments."""

from __future__ import annotations

import torch
from torch import Tensor

from ..render.view import View
from .convolution import Grid
from .kernels import HeldKernels, Kernels
from .light import light_of
from .methods import Blur, Method


class Blurring:
    """A camera's PSFs, its response and a method, ready to blur fragments on frames of any size.

    kernels: PSFs at depth nodes; response: [channel, band]; prepare: one of the methods;
    gap: difference in inverse depth below which two surfaces are one, in 1/m: their blurs differ by less
    than a pixel.
    """

    def __init__(
        self,
        kernels: Kernels,
        response: Tensor,
        prepare: Method,
        gap: float = 0.0,
    ) -> None:
        self.kernels = kernels
        self.response = response
        self.gap = gap
        self._prepare = prepare
        self._light: Blur | None = None
        self._coverage: Blur | None = None

    @property
    def reach(self) -> int:
        """How far a PSF carries light, in pixels."""
        return self.kernels.window // 2

    def light(self, view: View, which: Tensor, part: Tensor | None = None) -> Tensor:
        """Blurred light of some fragments: [channel, y, x] of the padded frame.

        which: int64 [n]; part: [n], the fraction of each fragment's light (default: all).
        """
        radiance = None if part is None else view.radiance.index_select(1, which) * part
        if self._light is None:
            self._light = self._prepare(self.kernels, self.response)
        return self._light(light_of(view, self.kernels.nodes, which, radiance), self._grid(view))

    def coverage(self, view: View, which: Tensor, amount: Tensor) -> Tensor:
        """How much some fragments block of what lies behind them: [channel, y, x] of the padded frame.

        which: int64 [n]; amount: [n], the coverage of each. It is blurred with the PSFs of each band and
        weighted by the response, as white light is. An opaque surface blocks everything though part of its
        light may leave the PSFs' windows: these PSFs sum to 1.
        """
        white = amount.expand(self.response.shape[0], -1)
        if self._coverage is None:
            one_each = torch.eye(len(self.response), dtype=self.response.dtype, device=self.response.device)
            opaque = opaque_kernels(self.kernels, self.response)
            self._coverage = self._prepare(opaque, one_each)
        return self._coverage(light_of(view, self.kernels.nodes, which, white), self._grid(view))

    def _grid(self, view: View) -> Grid:
        return Grid(*view.padded_shape, view.margin, self.kernels.window)


def opaque_kernels(kernels: Kernels, response: Tensor) -> HeldKernels:
    """PSFs of white light in each channel, each summing to 1: [node, channel, y, x] in the band's place."""
    layers = []
    for node in range(kernels.nodes.numel()):
        psf = kernels.layer(node)
        layers.append(torch.einsum("cb,byx->cyx", response, psf / psf.sum((-2, -1), keepdim=True)))
    colours = (response @ kernels.wavelengths.to(response)) / response.sum(1)
    return HeldKernels(torch.stack(layers), kernels.nodes, colours)
