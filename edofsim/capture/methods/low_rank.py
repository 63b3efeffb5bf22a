"""Low rank: all depths and bands through a few images, each convolved once (see `factors`)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from ..convolution import Grid, add_convolved, image_of
from ..factor_cache import factors_for
from ..factors import Factors, band_groups, factorise, joint_groups
from ..kernels import Kernels
from ..light import Light
from .base import Blur

BLOCK_PIXELS = 1 << 23
"""Pixels of all images at work at one time: bounds memory whatever the rank and the frame."""


def prepare(kernels: Kernels, response: Tensor, *, tolerance_db: float = 50.0) -> Blur:
    """Factor the PSFs, jointly over depth and band or band by band, whichever needs fewer convolutions."""

    def compute() -> list[Factors]:
        return factorise(kernels, [joint_groups(response), band_groups(response)], tolerance_db)

    return blur_with(factors_for(kernels, response, tolerance_db, compute), response)


def blur_with(factors: list[Factors], response: Tensor) -> Blur:
    """The blur that factors stand for. response: [channel, band]."""
    terms = _all_terms(factors, response)

    def blur(light: Light, grid: Grid) -> Tensor:
        block = max(1, BLOCK_PIXELS // math.prod(grid.transform))
        total: Tensor | None = None
        for begin in range(0, len(terms.basis), block):
            some = slice(begin, begin + block)
            images = light.mixed(terms.coefficients[:, some])
            total = add_convolved(total, images, terms.basis[some], terms.shares[:, some], grid)
        assert total is not None  # every factorisation has a term
        return image_of(total, grid)

    return blur


@dataclass(frozen=True)
class _Terms:
    """The terms of all groups in a row, so that the light is read once for all of them.

    basis: [term, y, x]; coefficients: [node, term, band of the view], 0 for bands that are not the group's;
    shares: [channel, term].
    """

    basis: Tensor
    coefficients: Tensor
    shares: Tensor


def _all_terms(factors: list[Factors], response: Tensor) -> _Terms:
    channels, bands = response.shape
    coefficients: list[Tensor] = []
    shares: list[Tensor] = []
    for each in factors:
        group, (rank, nodes, _) = each.group, each.coefficients.shape
        wide = each.coefficients.new_zeros(nodes, rank, bands)
        wide[:, :, group.bands] = each.coefficients.transpose(0, 1)
        share = response.new_zeros(channels, rank)
        share[group.channels] = group.shares[:, None].expand(-1, rank)
        coefficients.append(wide)
        shares.append(share)
    basis = torch.cat([each.basis for each in factors])
    return _Terms(basis, torch.cat(coefficients, 1), torch.cat(shares, 1))
