"""Layers: the light at each depth node is convolved with the node's PSF of each band.

Light between two nodes is shared by both (hat weights in inverse depth, in which defocus is linear). The
channels are summed as spectra, so that one transform back serves all depths and bands.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TypeAlias

from torch import Tensor

from ..optics import PsfField
from .convolution import Grid, add_convolved, image_of, spectrum
from .light import Light, SmoothLight

Blur: TypeAlias = Callable[[Light | SmoothLight, Grid], Tensor]
"""The image [channel, y, x] of light in the padded frame of a grid; linear in the light's radiance."""

BLOCK_PIXELS = 1 << 20
"""Pixels of all transforms at work at one time: what stays near a processor is transformed up to three times
as fast as what does not, and memory is bounded whatever the bands and the frame."""
KEPT_PIXELS = 1 << 22
"""Pixels of the PSFs' spectra of one node that are kept from one blur to the next."""
KEPT_NODES = 2
"""Nodes whose PSFs' spectra are kept: slabs that follow each other share that many."""


def layered(psfs: PsfField, response: Tensor) -> Blur:
    """A blur by PSFs at depth nodes under a response [channel, band], for frames of any size. Its error is
    that of the depth nodes alone. Light of one band is that of all.

    response: [channel, band].
    psfs: at depth nodes, [depth, band, y, x].
    """
    kept: dict[tuple[int, int, Grid], Tensor] = {}
    count = response.shape[1]

    def through(node: int, begin: int, block: int, grid: Grid) -> Tensor:
        found = kept.pop((node, begin, grid), None)
        if found is None:
            found = spectrum(psfs.layer(node)[begin : begin + block], grid)
        if count * math.prod(grid.transform) <= KEPT_PIXELS:
            kept[node, begin, grid] = found
            while len(kept) > KEPT_NODES * math.ceil(count / block):
                kept.pop(next(iter(kept)), None)
        return found

    def blur(light: Light | SmoothLight, grid: Grid) -> Tensor:
        block = max(1, BLOCK_PIXELS // math.prod(grid.transform))
        total = None
        for node in light.occupied_nodes():
            shared = spectrum(light.at_node(node), grid) if light.bands == 1 else None
            for begin in range(0, count, block):
                bands = slice(begin, begin + block)
                image = light.at_node(node, bands) if shared is None else shared
                psf = through(node, begin, block, grid)
                total = add_convolved(total, image, psf, response[:, bands], grid)
        if total is None:
            return light.radiance.new_zeros(response.shape[0], grid.rows, grid.columns)
        return image_of(total, grid)

    return blur
