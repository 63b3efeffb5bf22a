"""What occlusion is built from: the blurred light, and the blurred coverage, of any choice of fragments."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

import torch
from torch import Tensor

from ..render.view import View
from .convolution import Grid
from .kernels import HeldKernels, Kernels
from .light import light_of
from .methods import Blur, Method

HELD_SHARE = 0.5
"""Of a part's light at the depth that the window holds most of it at: with less it is not told apart."""
LEAST_LIGHT = 1e-3
"""Of all light: parts of less hold nothing but the diffraction of others' borders."""


class Blurring:
    """A camera's PSFs, its response and a method, ready to blur fragments on frames of any size.

    kernels: PSFs at depth nodes; response: [channel, band]; prepare: one of the methods;
    gap: difference in inverse depth below which two surfaces are one, in 1/m: their blurs differ by less
    than a pixel; parts: gives the same PSFs shared out among parts of the pupil, each as kernels of its own
    (default: the pupil is one part); part_db: what they are factored more finely by, as their errors add up.
    """

    def __init__(
        self,
        kernels: Kernels,
        response: Tensor,
        prepare: Method,
        tolerance_db: float = 50.0,
        gap: float = 0.0,
        parts: Callable[[], Iterable[Kernels]] | None = None,
        part_db: float = 0.0,
    ) -> None:
        self.kernels = kernels
        self.response = response
        self.gap = gap
        self._parts = parts
        self._prepare = prepare
        self._tolerance_db = tolerance_db
        self._part_db = part_db
        self._light: Blur | None = None
        self._coverage: Blur | None = None
        self._whole: Kernels | None = None

    @property
    def reach(self) -> int:
        """How far a PSF carries light, in pixels."""
        return self.kernels.window // 2

    def parts(self) -> Iterator[Blurring]:
        """The same through each part of the pupil: the blurred light of all parts sums up to that of this."""
        if self._parts is None:
            yield self
        else:
            for kernels in self._parts():
                finer = self._tolerance_db + self._part_db
                part = Blurring(kernels, self.response, self._prepare, finer, self.gap)
                part._whole = self.kernels
                yield part

    def light(self, view: View, which: Tensor, part: Tensor | None = None) -> Tensor:
        """Blurred light of some fragments: [channel, y, x] of the padded frame.

        which: int64 [n]; part: [n], the fraction of each fragment's light (default: all).
        """
        radiance = None if part is None else view.radiance.index_select(1, which) * part
        if self._light is None:
            self._light = self._prepare(self.kernels, self.response, tolerance_db=self._tolerance_db)
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
            opaque = opaque_kernels(self.kernels, self.response, self._whole)
            self._coverage = self._prepare(opaque, one_each, tolerance_db=self._tolerance_db)
        return self._coverage(light_of(view, self.kernels.nodes, which, white), self._grid(view))

    def _grid(self, view: View) -> Grid:
        return Grid(*view.padded_shape, view.margin, self.kernels.window)


def opaque_kernels(kernels: Kernels, response: Tensor, whole: Kernels | None = None) -> HeldKernels:
    """PSFs of white light in each channel, each summing to 1: [node, channel, y, x] in the band's place.

    whole: through all of the pupil, where `kernels` are of a part of it; they stand in where the part's light
    has left the window (`has_left`).
    """
    layers = []
    left = None if whole is None else has_left(kernels)
    for node in range(kernels.nodes.numel()):
        psf = kernels.layer(node)
        sums = psf.sum((-2, -1), keepdim=True)
        if left is not None and bool(left[node].any()):
            instead = left[node][:, None, None]
            psf = torch.where(instead, whole.layer(node), psf)
            sums = psf.sum((-2, -1), keepdim=True)
        layers.append(torch.einsum("cb,byx->cyx", response, psf / sums))
    colours = (response @ kernels.wavelengths.to(response)) / response.sum(1)
    key = None if kernels.key is None else f"{kernels.key} opaque {response.tolist()}"
    return HeldKernels(torch.stack(layers), kernels.nodes, colours, key, kernels.folder)


def has_left(kernels: Kernels) -> Tensor:
    """Where so much of the light through a part of the pupil lies outside the window that what is left of it
    does not tell what the part is blocked by: bool [node, band].

    A blur that is wider than the window moves all light of an outer part out of it. What stays is the
    diffraction of its border, of either sign, and must not be divided by its sum.
    """
    sums = torch.stack([kernels.layer(node).sum((-2, -1)) for node in range(kernels.nodes.numel())])
    most = sums.amax(0)
    return (sums < HELD_SHARE * most) | (most < LEAST_LIGHT)
