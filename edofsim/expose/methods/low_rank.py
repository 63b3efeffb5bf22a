"""Low rank: all depths and bands through a few images, each convolved once (see `factors`)."""

from __future__ import annotations

import torch
from torch import Tensor

from ..convolution import Grid, add_convolved, image_of
from ..factors import Factors, band_groups, factorise, joint_groups
from ..kernels import Kernels
from ..light import Light

BLOCK_PIXELS = 1 << 22
"""Pixels of all transforms at work at one time: bounds memory whatever the rank and the frame."""


def prepare(kernels: Kernels, response: Tensor, grid: Grid, *, tolerance_db: float = 50.0):
    """Factor the PSFs, jointly over depth and band or band by band, whichever needs fewer convolutions."""
    return blur_with(
        factorise(kernels, [joint_groups(response), band_groups(response)], tolerance_db), response, grid
    )


def blur_with(factors: list[Factors], response: Tensor, grid: Grid):
    """The blur that factors stand for."""
    rows, columns = grid.transform
    block = max(1, BLOCK_PIXELS // (rows * columns))

    def blur(light: Light) -> Tensor:
        channels: list[Tensor | None] = [None] * len(response)
        for each in factors:
            for begin in range(0, each.rank, block):
                terms = slice(begin, begin + block)
                images = light.mixed(each.coefficients[terms], each.group.bands)
                one = torch.ones(1, len(images), dtype=images.dtype, device=images.device)
                gained = add_convolved(None, images, each.basis[terms], one, grid)[0]
                for channel, share in zip(each.group.channels.tolist(), each.group.shares, strict=True):
                    before = channels[channel]
                    channels[channel] = share * gained if before is None else before + share * gained
        dark = light.radiance.new_zeros(grid.rows, grid.columns)
        return torch.stack([dark if c is None else image_of(c, grid) for c in channels])

    return blur
