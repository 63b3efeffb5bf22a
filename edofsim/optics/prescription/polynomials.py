"""Polynomials of two variables in a disc, even in the first: Chebyshev's, to a total degree."""

from __future__ import annotations

import math

import torch
from torch import Tensor

DEGREE = 12
TERMS = tuple((i, j) for i in range(0, DEGREE + 1, 2) for j in range(DEGREE + 1 - i))
REACH = 1.1
"""They are fitted, and used, out to this many radii of the disc; beyond, they stay as at the edge of a
square."""
NODES = DEGREE + 2


def chebyshev(x: Tensor, count: int) -> Tensor:
    """T_0 to T_(count - 1), [..., count].

    x: any shape [...], from -1 to 1.
    """
    found = [torch.ones_like(x), x]
    for _ in range(2, count):
        found.append(2 * x * found[-1] - found[-2])
    return torch.stack(found[:count], -1)


def basis(a: Tensor, b: Tensor) -> Tensor:
    """Each term at places, [..., term].

    a: any shape [...], along.
    b: any shape [...], across.
    """
    across, along = chebyshev(a, DEGREE + 1), chebyshev(b, DEGREE + 1)
    return torch.stack([across[..., i] * along[..., j] for i, j in TERMS], -1)


def fit(a: Tensor, b: Tensor, weight: Tensor, values: Tensor, odd: bool = False) -> Tensor:
    """Coefficients [batch, term, quantity] of the polynomials nearest to values [batch, place, quantity].

    a: [batch, place], along.
    b: [batch, place], across.
    weight: [batch, place].
    values: [batch, place, quantity].
    odd: times a. Where places do not fix them, the smallest.
    """
    terms = basis(a, b) * weight[..., None]
    if odd:
        terms = terms * a[..., None]
    return torch.linalg.lstsq(terms, values * weight[..., None], driver="gelsd").solution


def values_at(even: Tensor, odd: Tensor, a: Tensor, b: Tensor) -> Tensor:
    """Quantities [quantity, ...] at places: the odd ones after the even ones.

    even, odd: [term, quantity].
    a: any shape [...], along.
    b: any shape [...], across.
    """
    terms = basis(a, b)
    return torch.cat([terms @ even, (terms @ odd) * a[..., None]], -1).movedim(-1, 0)


def values_on(even: Tensor, odd: Tensor, right: Tensor, up: Tensor, turn: float) -> Tensor:
    """Quantities [quantity, up, right] on a grid, in units of the disc, whose frame is turned against the
    polynomials': their second variable runs along (cos turn, sin turn) of it.

    even, odd: [term, quantity].
    right: [right], in units of the disc.
    up: [up], in units of the disc.

    Exact: a polynomial of the total degree is one in the other frame, too.
    """
    box = float(torch.cat([right, up]).abs().max()) or 1.0
    nodes = torch.cos(math.pi * (torch.arange(NODES, dtype=torch.float64) + 0.5) / NODES)
    to_terms = 2 / NODES * chebyshev(nodes, NODES).T
    to_terms[0] /= 2
    x, y = nodes[None, :] * box, nodes[:, None] * box
    cosine, sine = math.cos(turn), math.sin(turn)
    known = values_at(even, odd, x * sine - y * cosine, x * cosine + y * sine)
    terms = to_terms @ known @ to_terms.T
    return chebyshev(up / box, NODES) @ terms @ chebyshev(right / box, NODES).T
