"""Zernike polynomials in Noll's order and normalisation (R. J. Noll, J. Opt. Soc. Am. 66, 207, 1976)."""

from __future__ import annotations

import math

import torch
from torch import Tensor


def noll_orders(index: int) -> tuple[int, int]:
    """Radial order n and signed azimuthal order m of Noll's index (1 is piston); m < 0 means a sine."""
    n = int((math.sqrt(8 * index - 7) - 1) // 2)
    place = index - n * (n + 1) // 2 - 1
    m = 2 * ((place + (n + 1) % 2) // 2) + n % 2
    return n, m if index % 2 == 0 else -m


def zernike(index: int, u: Tensor, v: Tensor) -> Tensor:
    """Z_index at (u, v) broadcast, unit RMS over the disc of radius 1; angle counted from u towards v.

    u: any shape [...] that broadcasts with v.
    v: any shape [...] that broadcasts with u.
    index: by Noll, from 1.

    Evaluated from powers of rho^2 and of u + i v, so that it is smooth everywhere, the centre included.
    """
    n, m = noll_orders(index)
    size = abs(m)
    square = u**2 + v**2
    radial = torch.zeros_like(square)
    for k in range((n - size) // 2 + 1):
        weight = (-1) ** k * math.factorial(n - k)
        weight /= (
            math.factorial(k) * math.factorial((n + size) // 2 - k) * math.factorial((n - size) // 2 - k)
        )
        radial = radial + weight * square ** ((n - size) // 2 - k)
    real, imaginary = torch.ones_like(square), torch.zeros_like(square)
    for _ in range(size):
        real, imaginary = real * u - imaginary * v, real * v + imaginary * u
    norm = math.sqrt(n + 1) if m == 0 else math.sqrt(2 * (n + 1))
    return norm * radial * (real if m >= 0 else imaginary)
