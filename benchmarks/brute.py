"""Brute force: for every depth and every band, the band's light at that depth is convolved on its own.

What everybody writes first, and what layers are measured against: each (depth, band) pair costs the
transforms of its light and of its PSF and one back.
"""

from __future__ import annotations

import torch
from torch import Tensor

from edofsim.capture.convolution import Grid, add_convolved, image_of
from edofsim.capture.layers import Blur
from edofsim.capture.light import Light, SmoothLight
from edofsim.optics import PsfField


def brute(psfs: PsfField, response: Tensor) -> Blur:
    """As `edofsim.capture.layers.layered`, pair by pair."""

    def blur(light: Light | SmoothLight, grid: Grid) -> Tensor:
        photo = light.radiance.new_zeros(response.shape[0], grid.rows, grid.columns)
        one = torch.ones(1, 1, dtype=photo.dtype, device=photo.device)
        for node in light.occupied_nodes():
            each_band = psfs.layer(node)
            for band in range(response.shape[1]):
                each = slice(band, band + 1)
                image = light.at_node(node, each if light.bands > 1 else slice(None))
                total = add_convolved(None, image, each_band[each], one, grid)
                photo = photo + response[:, band, None, None] * image_of(total, grid)
        return photo

    return blur
