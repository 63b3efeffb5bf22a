"""The defocus of many depths as even factors of the pupil: one a depth, or a few that all depths share.

exp(j Psi rho^2) changes slowly with Psi: over a range of width 2 a it is a Chebyshev series in rho^2 of about
a / 2 terms and a dozen, however many depths lie in the range. Fields are linear in the pupil, so the transform
is done once a term, and the field of each depth is a weighted sum.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import torch
from torch import Tensor

from .grid import PupilGrid
from .pupil import chirp

SERIES_GAIN = 1.3
"""How many depths a term of the series has to serve for it to be the faster way."""
SERIES_BYTES = 256 << 20
"""Largest size of the terms' maps; beyond it depths are done one by one."""


@dataclass(frozen=True)
class Defocus:
    """The defocus of some depths at one wavelength.

    offset: complex [s, s], a defocus that all of them share. Then either chirps: complex [depth, half], each
    depth's own factor along one axis of the pupil; or maps: real [2 (re, im), half, term, half], the series'
    terms, with weights [depth, term].
    """

    offset: Tensor | None
    chirps: Tensor | None = None
    maps: Tensor | None = None
    weights: Tensor | None = None

    def blocks(self, size: int) -> Iterator[Tensor]:
        """The factors, `size` at a time, as real [2 (re, im), half, factor, half]."""
        if self.maps is not None:
            yield from self.maps.split(size, dim=2)
            return
        for chirps in self.chirps.split(size):
            both = chirps.T[:, :, None] * chirps[None, :, :]
            yield torch.stack([both.real, both.imag])


def defocus_factors(grid: PupilGrid, psi: Tensor, dtype: torch.dtype, device: torch.device) -> list[Defocus]:
    """The defocus of each band, the faster way, from psi [depth, band] (float64)."""
    lowest, highest = psi.amin(0), psi.amax(0)
    limit = (1 + grid.pitch / grid.radius) ** 2  # rho^2 of the outermost cell that the pupil's edge crosses
    terms = terms_needed(float((highest - lowest).max()) / 2 * limit / 2, dtype)
    half = grid.samples - grid.samples // 2
    if terms * SERIES_GAIN > len(psi) or 2 * half * half * terms * dtype.itemsize > SERIES_BYTES:
        chirps = (chirp(grid, of_band, dtype=dtype, device=device) for of_band in psi.unbind(1))
        return [Defocus(None, chirps=of_band[:, grid.samples // 2 :]) for of_band in chirps]
    maps = _terms(grid, terms, limit, dtype, device)
    ways = []
    for of_band, centre in zip(psi.unbind(1), ((lowest + highest) / 2).unbind(), strict=True):
        shared = chirp(grid, centre[None], dtype=dtype, device=device)[0]
        weights = chebyshev_weights((of_band - centre) * limit / 2, terms)
        ways.append(Defocus(shared[:, None] * shared[None, :], maps=maps, weights=weights.to(device, dtype)))
    return ways


def terms_needed(argument: float, dtype: torch.dtype) -> int:
    """Terms of the series of exp(j argument x) on [-1, 1], so that what is left out is below rounding."""
    tolerance = 1e-7 if dtype == torch.float32 else 1e-14
    count = 40 + 2 * math.ceil(argument)
    sizes = chebyshev_weights(torch.tensor([argument], dtype=torch.float64), count)[0].abs()
    return max(1, int((sizes.flip(0).cumsum(0).flip(0) > tolerance).sum()))


def _terms(grid: PupilGrid, terms: int, limit: float, dtype: torch.dtype, device: torch.device) -> Tensor:
    """Chebyshev polynomials T_k(2 rho^2 / limit - 1) on a quarter of the pupil, the odd ones times j."""
    square = (grid.centres[grid.samples // 2 :] / grid.radius) ** 2
    angle = torch.arccos(2 * (square[:, None] + square[None, :]).clamp_max(limit) / limit - 1)
    maps = torch.zeros(2, len(square), terms, len(square), dtype=dtype, device=device)
    for term in range(terms):
        maps[term % 2, :, term] = torch.cos(term * angle).to(device, dtype)
    return maps


def chebyshev_weights(argument: Tensor, count: int) -> Tensor:
    """Real weights [depth, count] of exp(j argument x) on [-1, 1], the j of the odd terms taken out.

    2 i^k J_k(argument) by the Jacobi-Anger expansion; here by a discrete cosine transform on a grid so fine that
    nothing folds back. argument: [depth], float64.
    """
    nodes = 2 * (count + math.ceil(float(argument.abs().max())) + 16)
    angle = (torch.arange(nodes, dtype=torch.float64) + 0.5) * (math.pi / nodes)
    orders = torch.arange(count, dtype=torch.float64)
    cosines = torch.cos(orders[:, None] * angle) * (2 / nodes)
    cosines[0] /= 2
    phase = argument[:, None] * torch.cos(angle)
    even, odd = torch.cos(phase) @ cosines.T, torch.sin(phase) @ cosines.T
    return torch.where(orders % 2 == 0, even, odd)
