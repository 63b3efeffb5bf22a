"""Low rank: the PSFs of many depths and bands as combinations of few images, with the error known beforehand.

The PSFs p_i, i = (node, band), are weighted by what the prior expects of an image: G_ij = <p_i, p_j> weighted
by the image's power at each frequency, C the correlation of bands. The leading eigenvectors of the small
matrix C^1/2 G C^1/2 give the combinations of PSFs (`basis`) in which all are expressed (`coefficients`) with
the least expected error. Where there are many nodes, the basis is made from some of them, from more if that
is not enough; the coefficients, and the expected error, are those of all.
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
MOST_PSFS = 1024
"""PSFs that a basis is made from at first."""


ROUNDING = {torch.float32: 1e-8, torch.float64: 1e-13}
"""Of the products of PSFs: combinations that hold less of all their energy than this are noise."""


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

    basis: [rank, y, x]; coefficients: [rank, node, band of the group]; combination: [rank - 1, node of
    `sources`, band of the group], what makes the basis from the weighted PSFs of the nodes `sources`, int64
    [source] (the last term keeps the energy); predicted_db: PSNR at the worst node, under the prior, of the
    group's image against the unfactored one.
    """

    group: Group
    basis: Tensor
    coefficients: Tensor
    combination: Tensor
    sources: Tensor
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
    nodes = kernels.nodes.numel()
    count = min(nodes, max(2, MOST_PSFS // kernels.wavelengths.numel()))
    found = _factorised(kernels, groups, tolerance_db, count)
    while count < nodes and min(each.predicted_db for each in found) < tolerance_db:
        count = min(nodes, 2 * count)
        found = _factorised(kernels, groups, tolerance_db, count)
    return found


def _factorised(
    kernels: Kernels, groups: list[list[Group]], tolerance_db: float, count: int
) -> list[Factors]:
    """The same with a basis from so many of the nodes."""
    nodes, bands = kernels.nodes.numel(), kernels.wavelengths.numel()
    sources = torch.linspace(0, nodes - 1, count, dtype=torch.float64).round().long()
    psfs = torch.stack([kernels.layer(k).detach() for k in sources.tolist()])
    rows = _weighted_spectra(psfs.flatten(0, 1))
    gram = _products(rows, rows).reshape(count, bands, count, bands)
    allowed = 10 ** (-tolerance_db / 10)
    mixes = [[_leading_mixes(gram, kernels, group, allowed) for group in way] for way in groups]
    way = min(range(len(groups)), key=lambda k: sum(estimate for _, estimate in mixes[k]))
    mixed = [_orthonormal(psfs, g, mix) for g, (mix, _) in zip(groups[way], mixes[way], strict=True)]
    bases = [basis for basis, _ in mixed]
    coefficients, energies, squares = _projected(kernels, groups[way], bases)
    mean = psfs.sum((0, 1))
    mean = mean / mean.sum()
    return [
        _truncated(kernels, group, mix, basis, c, e, s, sources, mean, allowed)
        for group, (basis, mix), c, e, s in zip(
            groups[way], mixed, coefficients, energies, squares, strict=True
        )
    ]


def refreshed(factors: Factors, kernels: Kernels) -> Factors:
    """The same combinations of PSFs that changed a little, as those of a DOE do between training steps.

    Gradients pass through the basis to the PSFs.
    """
    group, last = factors.group, len(factors.combination)
    psfs = torch.stack([kernels.layer(k) for k in factors.sources.tolist()])
    basis = _combined(psfs, group, factors.combination)
    layers = (kernels.layer(k).detach()[group.bands] for k in range(kernels.nodes.numel()))
    energy = torch.stack([psf.sum((-2, -1)) * group.weights for psf in layers])
    mean = factors.basis[last].detach()
    return _keeping_energy(factors.coefficients[:last], basis, energy, mean, factors)


def measured_db(factors: Factors, kernels: Kernels, nodes: list[int]) -> float:
    """Expected PSNR of factors for PSFs at some nodes, the worst of them: tells when to factor afresh."""
    bands = factors.group.bands
    root = _root(kernels, factors.group)
    worst = 0.0
    for node in nodes:
        psf = kernels.layer(node).detach()[bands] * factors.group.weights[:, None, None]
        error = psf - torch.einsum("kb,kyx->byx", factors.coefficients[:, node], factors.basis.detach())
        worst = max(worst, float((root.T @ _weighted_spectra(error).double()).square().sum()))
    return _decibel(worst)


def _weighted_spectra(images: Tensor) -> Tensor:
    """Images [n, y, x] to real rows [n, m] whose products are the prior's expectation for images."""
    power = image_power(*images.shape[-2:]).to(images.device, images.dtype)
    spectra = torch.fft.rfft2(images) * power.sqrt()
    return torch.view_as_real(spectra).reshape(images.shape[0], -1)


def _products(first: Tensor, second: Tensor) -> Tensor:
    """Products of weighted spectra [n, m] and [k, m], float64 [n, k].

    Their mean, in the first two numbers, outweighs the thousands that follow: added up in single precision
    it swallows them, 5e-5 of the whole, as much as the error that 43 dB allow.
    """
    mean = first[:, :2].double() @ second[:, :2].double().T
    return mean + (first[:, 2:] @ second[:, 2:].T).double()


def _root(kernels: Kernels, group: Group) -> Tensor:
    """Cholesky factor of the correlation of a group's bands, float64."""
    return torch.linalg.cholesky(band_correlation(kernels.wavelengths[group.bands])).to(group.weights.device)


def _leading_mixes(gram: Tensor, kernels: Kernels, group: Group, allowed: float) -> tuple[Tensor, int]:
    """Combinations [k, source, band] of the weighted PSFs, best first, that are orthonormal under the prior;
    and an estimate of how many are needed for a mean square error of `allowed`.

    gram: [source, band, source, band] of all bands.
    """
    weights = group.weights.detach().double()
    root = _root(kernels, group)
    part = gram[:, group.bands][:, :, :, group.bands] * weights[:, None, None] * weights
    matrix = torch.einsum("ibjc,bd,ce->idje", part, root, root)
    count, bands = matrix.shape[:2]
    floor = ROUNDING[group.weights.dtype]
    values, vectors = _leading(matrix.reshape(count * bands, -1), allowed * count, floor)
    mixes = torch.einsum("kid,bd->kib", (vectors / values.sqrt()).T.reshape(-1, count, bands), root)
    total = matrix.reshape(count * bands, -1).diagonal().sum()
    left = (total - values.cumsum(0)) / count
    return mixes.to(group.weights.dtype), int((left > allowed).sum()) + 1


def _combined(psfs: Tensor, group: Group, mixes: Tensor) -> Tensor:
    """Combinations [k, y, x] of a group's weighted PSFs [source, band, y, x]."""
    return torch.einsum("kib,ibyx->kyx", mixes * group.weights, psfs[:, group.bands])


def _orthonormal(psfs: Tensor, group: Group, mixes: Tensor) -> tuple[Tensor, Tensor]:
    """The combinations of PSFs [source, band, y, x] that `mixes` [k, source, band] stand for, and the mixes,
    made orthonormal under the prior one after the other: rounding in the products of PSFs, little against
    the first of them, is much against the last, which are left out where nothing else is in them.
    """
    basis = _combined(psfs, group, mixes)
    axes = _weighted_spectra(basis)
    lower, failed = torch.linalg.cholesky_ex(_products(axes, axes))
    count = int(failed) - 1 if int(failed) else len(basis)
    turn = torch.linalg.inv(lower[:count, :count]).to(mixes)
    mixes = torch.einsum("jk,kib->jib", turn, mixes[:count])
    return torch.einsum("jk,kyx->jyx", turn, basis[:count]), mixes


def _projected(
    kernels: Kernels, groups: list[Group], bases: list[Tensor]
) -> tuple[list[Tensor], list[Tensor], list[Tensor]]:
    """Of each group: coefficients [k, node, band] in its orthonormal basis, energies [node, band] of its
    weighted PSFs, and what the prior expects of the squares of their images, [node]."""
    axes = [_weighted_spectra(basis) for basis in bases]
    roots = [_root(kernels, group) for group in groups]
    found: list[tuple[list[Tensor], list[Tensor], list[Tensor]]] = [([], [], []) for _ in groups]
    for node in range(kernels.nodes.numel()):
        psf = kernels.layer(node).detach()
        rows, sums = _weighted_spectra(psf), psf.sum((-2, -1))
        for group, axis, root, (coefficients, energies, squares) in zip(
            groups, axes, roots, found, strict=True
        ):
            own = rows[group.bands] * group.weights[:, None]
            coefficients.append(_products(axis, own).to(axis))
            energies.append(sums[group.bands] * group.weights)
            squares.append((root.T @ own.double()).square().sum())
    return (
        [torch.stack(coefficients, 1) for coefficients, _, _ in found],
        [torch.stack(energies) for _, energies, _ in found],
        [torch.stack(squares) for _, _, squares in found],
    )


def _truncated(
    kernels: Kernels,
    group: Group,
    mix: Tensor,
    basis: Tensor,
    coefficients: Tensor,
    energy: Tensor,
    squares: Tensor,
    sources: Tensor,
    mean: Tensor,
    allowed: float,
) -> Factors:
    """As few terms as keep the error of every node within `allowed`, and one that keeps the energy."""
    root = _root(kernels, group)
    explained = torch.einsum("knb,bc->knc", coefficients.double(), root).square().sum(2)  # [term, node]
    errors = (squares - explained.cumsum(0)).clamp_min(0).amax(1)  # of the worst node, by rank
    enough = torch.nonzero(errors <= allowed).squeeze(1)
    rank = int(enough[0]) + 1 if enough.numel() else errors.numel()
    found = Factors(group, basis[:rank], coefficients[:rank], mix[:rank], sources, _decibel(errors[rank - 1]))
    return _keeping_energy(coefficients[:rank], basis[:rank], energy, mean, found)


def _keeping_energy(
    coefficients: Tensor, basis: Tensor, energy: Tensor, mean: Tensor, factors: Factors
) -> Factors:
    """One more term, the mean PSF, with which every PSF has the energy [node, band] that it should have."""
    has = torch.einsum("kdb,k->db", coefficients, basis.detach().sum((-2, -1)))
    return replace(
        factors,
        basis=torch.cat([basis, mean[None]]),
        coefficients=torch.cat([coefficients, (energy - has)[None]]),
    )


def _leading(matrix: Tensor, allowed: float, floor: float) -> tuple[Tensor, Tensor]:
    """Eigenvalues, descending, and vectors of a symmetric matrix, until little against `allowed` is left;
    those below `floor` times their sum are rounding."""
    size = matrix.shape[0]
    total = float(matrix.diagonal().sum())
    floor = total * floor
    count = 128
    generator = torch.Generator().manual_seed(0)
    while size > EXACT_BELOW and count < size // 3:
        probe = torch.randn(size, count + 16, generator=generator, dtype=matrix.dtype).to(matrix.device)
        for _ in range(2):
            probe = torch.linalg.qr(matrix @ probe).Q
        values, vectors = torch.linalg.eigh(probe.T @ matrix @ probe)
        values, vectors = values.flip(0)[:count], (probe @ vectors).flip(1)[:, :count]
        if total - float(values.sum()) < allowed / 100 or float(values[-1]) < floor:
            break
        count *= 2
    else:
        values, vectors = torch.linalg.eigh(matrix)
        values, vectors = values.flip(0), vectors.flip(1)
    keep = values > floor
    return values[keep], vectors[:, keep]


def _decibel(square: Tensor | float) -> float:
    return -10 * math.log10(max(float(square), 1e-30))
