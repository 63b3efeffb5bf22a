"""Low rank: the PSFs of many depths and bands as combinations of few images, with the error known beforehand.

The PSFs p_i, i = (node, band), are weighted by what the prior expects of an image: G_ij = <p_i, p_j> weighted
by the image's power at each frequency, C the correlation of bands. The leading eigenvectors of the small
matrix C^1/2 G C^1/2 give the combinations of PSFs (`basis`) in which all are expressed (`coefficients`) with
the least expected error; the discarded eigenvalues are that error.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from .kernels import Kernels
from .prior import band_correlation, image_power

EXACT_BELOW = 700
"""Matrices up to this size are decomposed whole; larger ones by random projection."""


@dataclass(frozen=True)
class Group:
    """Bands that are summed before they are convolved, and the channels that the result goes to.

    bands: int64 [band]; weights: [band] of each; channels: int64 [channel]; shares: [channel] of each.
    Joint: all bands of one channel. Per band: one band, shared by all channels.
    """

    bands: Tensor
    weights: Tensor
    channels: Tensor
    shares: Tensor


@dataclass(frozen=True)
class Factors:
    """PSFs of a group in few terms: weights[b] psf[d, b] = sum_k coefficients[k, d, b] basis[k].

    basis: [rank, y, x]; coefficients: [rank, node, band of the group]; combination: [rank - 1, node * band
    of the group], what makes the basis from the weighted PSFs (the last term keeps the energy);
    predicted_db: PSNR at the worst node, under the prior, of the group's image against the unfactored one.
    """

    group: Group
    basis: Tensor
    coefficients: Tensor
    combination: Tensor
    predicted_db: float

    @property
    def rank(self) -> int:
        return int(self.basis.shape[0])


def joint_groups(response: Tensor) -> list[Group]:
    """One group a channel: the bands that the channel sees. response: [channel, band]."""
    groups = []
    for channel, weights in enumerate(response):
        bands = torch.nonzero(weights).squeeze(1)
        one = torch.ones(1, dtype=response.dtype, device=response.device)
        groups.append(Group(bands, weights[bands], torch.tensor([channel], device=response.device), one))
    return [group for group in groups if group.bands.numel()]


def band_groups(response: Tensor) -> list[Group]:
    """One group a band that some channel sees."""
    groups = []
    for band in torch.nonzero(response.any(0)).squeeze(1):
        channels = torch.nonzero(response[:, band]).squeeze(1)
        one = torch.ones(1, dtype=response.dtype, device=response.device)
        groups.append(Group(band.reshape(1), one, channels, response[channels, band]))
    return groups


def factorise(kernels: Kernels, groups: list[list[Group]], tolerance_db: float) -> list[Factors]:
    """The cheapest of several ways to group the bands, each factored to the tolerance.

    groups: the alternatives. The rank of a group is the least for which no depth node is expected to err by
    more than `tolerance_db` below full scale.
    """
    gram = weighted_gram(kernels)
    best = min(
        ([_truncated(gram, kernels, group, tolerance_db) for group in way] for way in groups),
        key=lambda way: sum(rank for *_, rank, _ in way),
    )
    return [
        _keeping_energy(Factors(group, _basis(kernels, group, mix), coefficients, mix, decibel), kernels)
        for group, mix, coefficients, _, decibel in best
    ]


def refreshed(factors: Factors, kernels: Kernels) -> Factors:
    """The same combinations of PSFs that changed a little, as those of a DOE do between training steps."""
    terms = slice(len(factors.combination))
    same = replace(factors, coefficients=factors.coefficients[terms])
    return _keeping_energy(replace(same, basis=_basis(kernels, factors.group, factors.combination)), kernels)


def measured_db(factors: Factors, kernels: Kernels, nodes: list[int]) -> float:
    """Expected PSNR of factors for PSFs at some nodes, the worst of them: tells when to factor afresh."""
    bands = factors.group.bands
    root = torch.linalg.cholesky(band_correlation(kernels.wavelengths[bands]))
    worst = 0.0
    for node in nodes:
        psf = kernels.layer(node).detach()[bands] * factors.group.weights[:, None, None]
        error = psf - torch.einsum("kb,kyx->byx", factors.coefficients[:, node], factors.basis.detach())
        rows = _weighted_spectra(error).double()
        worst = max(worst, float((root.to(rows).T @ rows).square().sum()))
    return -10 * math.log10(max(worst, 1e-30))


def weighted_gram(kernels: Kernels) -> Tensor:
    """G[i, j] of all PSFs, float64 [node * band, node * band], i = node * bands + band."""
    rows = torch.cat([_weighted_spectra(kernels.layer(k).detach()) for k in range(kernels.nodes.numel())])
    return (rows @ rows.T).double()


def _weighted_spectra(images: Tensor) -> Tensor:
    """Images [n, y, x] to real rows [n, m] whose products are the prior's expectation for images."""
    power = image_power(*images.shape[-2:]).to(images.device, images.dtype)
    spectra = torch.fft.rfft2(images) * power.sqrt()
    return torch.view_as_real(spectra).reshape(images.shape[0], -1)


def _truncated(
    gram: Tensor, kernels: Kernels, group: Group, tolerance_db: float
) -> tuple[Group, Tensor, Tensor, int, float]:
    """(group, combination, coefficients, rank, predicted PSNR) of one group."""
    nodes, bands = kernels.nodes.numel(), group.bands.numel()
    every = gram.shape[0] // nodes
    index = (torch.arange(nodes, device=gram.device)[:, None] * every + group.bands[None, :]).reshape(-1)
    weights = group.weights.detach().double().repeat(nodes)
    gram = gram[index][:, index] * weights[:, None] * weights[None, :]
    root = torch.linalg.cholesky(band_correlation(kernels.wavelengths[group.bands])).to(gram)
    half = torch.einsum("nbm,bc->ncm", gram.reshape(nodes, bands, -1), root).reshape(nodes * bands, -1)
    whole = torch.einsum("mnb,bc->mnc", half.reshape(-1, nodes, bands), root).reshape(nodes * bands, -1)
    allowed = 10 ** (-tolerance_db / 10)
    at_nodes = whole.diagonal().reshape(nodes, bands).sum(1)  # expected square of each node's image
    values, vectors = _leading(whole, allowed)
    mix = torch.einsum("bc,knc->knb", root, (vectors / values.sqrt()).T.reshape(-1, nodes, bands))
    mix = mix.reshape(-1, nodes * bands)
    coefficients = (mix @ gram).reshape(-1, nodes, bands)
    explained = torch.einsum("knb,bc->knc", coefficients, root).square().sum(2)  # [rank, node]
    errors = (at_nodes - explained.cumsum(0)).clamp_min(0).amax(1)  # of the worst node, by rank
    enough = torch.nonzero(errors <= allowed).squeeze(1)
    rank = int(enough[0]) + 1 if enough.numel() else errors.numel()
    decibel = -10 * math.log10(max(float(errors[rank - 1]), 1e-30))
    dtype = group.weights.dtype
    return group, mix[:rank].to(dtype), coefficients[:rank].to(dtype), rank, decibel


def _leading(matrix: Tensor, allowed: float) -> tuple[Tensor, Tensor]:
    """Eigenvalues, descending, and vectors of a symmetric matrix, until what is left is below `allowed`."""
    size = matrix.shape[0]
    floor = float(matrix.diagonal().sum()) * 1e-13
    count = 192
    generator = torch.Generator().manual_seed(0)
    while size > EXACT_BELOW and count < size // 3:
        probe = torch.randn(size, count + 16, generator=generator, dtype=matrix.dtype).to(matrix.device)
        for _ in range(2):
            probe = torch.linalg.qr(matrix @ probe).Q
        values, vectors = torch.linalg.eigh(probe.T @ matrix @ probe)
        values, vectors = values.flip(0)[:count], (probe @ vectors).flip(1)[:, :count]
        if float(matrix.diagonal().sum() - values.sum()) < allowed or float(values[-1]) < floor:
            keep = values > floor
            return values[keep], vectors[:, keep]
        count *= 2
    values, vectors = torch.linalg.eigh(matrix)
    values, vectors = values.flip(0), vectors.flip(1)
    keep = values > floor
    return values[keep], vectors[:, keep]


def _keeping_energy(factors: Factors, kernels: Kernels) -> Factors:
    """One more term, the mean PSF, with which every PSF has the energy that it should have, exactly."""
    group = factors.group
    layers = (kernels.layer(k).detach()[group.bands] for k in range(kernels.nodes.numel()))
    energy, mean = [], 0
    for psf in layers:
        energy.append(psf.sum((-2, -1)) * group.weights)
        mean = mean + psf.sum(0)
    has = torch.einsum("kdb,k->db", factors.coefficients, factors.basis.detach().sum((-2, -1)))
    lacks = (torch.stack(energy) - has)[None]
    return replace(
        factors,
        basis=torch.cat([factors.basis, (mean / mean.sum())[None]]),
        coefficients=torch.cat([factors.coefficients, lacks]),
    )


def _basis(kernels: Kernels, group: Group, mix: Tensor) -> Tensor:
    """Combinations of the group's weighted PSFs: [rank, y, x]; gradients pass to the PSFs."""
    bands = group.bands.numel()
    weighted = mix.reshape(mix.shape[0], -1, bands) * group.weights
    basis = 0
    for node in range(kernels.nodes.numel()):
        psf = kernels.layer(node)[group.bands]
        basis = basis + (weighted[:, node] @ psf.reshape(bands, -1))
    return basis.reshape(mix.shape[0], *psf.shape[-2:])
