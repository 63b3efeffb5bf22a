"""Layers: the light at each depth node is convolved with the node's PSF of each band.

Light between two nodes is shared by both (hat weights in inverse depth, in which defocus is linear). The
channels are summed as spectra, so that one transform back serves all depths and bands.
"""

from __future__ import annotations

import math

from torch import Tensor

from ..convolution import Grid, add_convolved, image_of, spectrum
from ..kernels import Kernels
from ..light import Light
from .base import Blur

BLOCK_PIXELS = 1 << 22
"""Pixels of all transforms at work at one time: bounds memory whatever the bands and the frame."""
KEPT_NODES = 2
"""Nodes whose PSFs' spectra are kept from one blur to the next: slabs that follow each other share that many.
They are where all bands are in one block."""


def prepare(kernels: Kernels, response: Tensor) -> Blur:
    """Nothing to prepare: the error is that of the depth nodes alone."""
    kept: dict[tuple[int, Grid], Tensor] = {}

    def spectra(node: int, bands: slice, grid: Grid, whole: bool) -> Tensor:
        found = kept.pop((node, grid), None)
        if found is None:
            found = spectrum(kernels.layer(node)[bands], grid)
        if whole:
            kept[node, grid] = found
            while len(kept) > KEPT_NODES:
                kept.pop(next(iter(kept)), None)
        return found

    def blur(light: Light, grid: Grid) -> Tensor:
        block = max(1, BLOCK_PIXELS // math.prod(grid.transform))
        total = None
        for node in light.occupied_nodes():
            for begin in range(0, light.bands, block):
                bands = slice(begin, begin + block)
                image = light.at_node(node, bands)
                psf = spectra(node, bands, grid, light.bands <= block)
                total = add_convolved(total, image, psf, response[:, bands], grid)
        if total is None:
            return light.radiance.new_zeros(response.shape[0], grid.rows, grid.columns)
        return image_of(total, grid)

    return blur
