"""Between depths: a PSF is band-limited in defocus, so that few depths tell all others.

With u = rho^2, the field in a place on the sensor is F(Psi) = int_0^1 q(u) exp(j Psi u) du (Akpinar et al.,
Eq. `Q`), and what lands there, |F|^2, has no frequency beyond 1 per radian of Psi, whatever the mask. So has
each summand of sub-apertures. Of all functions with the spectrum of |F|^2 where q is even, a triangle, the
weights below are the best linear ones that leave a constant as it is, so that no light is made or lost
(ordinary kriging: G. Matheron, Economic Geology 58, 1246, 1963), and their error is known before anything is
computed.
"""

from __future__ import annotations

import math
from functools import lru_cache

import torch
from torch import Tensor

ROUNDING = 1e-12
"""Of the nodes' correlations, so that nearly equal ones can be distinguished."""
CHECKS = 8
"""Places in each interval between nodes at which the error is looked at."""


def band_limited_nodes(low: float, high: float, per_dioptre: float, error: float) -> Tensor:
    """The fewest nodes, ascending, float64 [node] in 1/m, from which a PSF at any inverse depth from `low` to
    `high` is known to within `error`, relative and in the root mean square over all that are band-limited.

    per_dioptre: change of Psi with inverse depth, rad m, at the shortest wavelength.
    """
    places = _places(round(max(0.0, high - low) * per_dioptre / 2, 9), error)
    return (low + high) / 2 + (high - low) / 2 * torch.tensor(places, dtype=torch.float64)


def fewest_nodes(low: float, high: float, per_dioptre: float) -> float:
    """Number of nodes below which `band_limited_nodes` finds none that do, whatever the error: Nyquist's."""
    return (high - low) * per_dioptre / math.pi - 2


def band_limited_weights(at: Tensor, nodes: Tensor, per_dioptre: float) -> Tensor:
    """Weights [n, node], float64, of what is known at `nodes` [node] for the inverse depths `at` [n], 1/m.

    at: [n], 1/m.
    nodes: [node], 1/m.
    per_dioptre: change of Psi with inverse depth, rad m.
    """
    return _weights(at.double() * per_dioptre, nodes.to(at.device, torch.float64) * per_dioptre)


def _weights(at: Tensor, nodes: Tensor) -> Tensor:
    count = len(nodes)
    system = nodes.new_ones(count + 1, count + 1)  # Lagrange's multiplier keeps each sum of weights at 1
    system[:count, :count] = _correlation(nodes, nodes) + ROUNDING * torch.eye(count).to(nodes)
    system[count, count] = 0
    asked = torch.cat([_correlation(at, nodes), at.new_ones(len(at), 1)], 1)
    return torch.linalg.solve(system, asked, left=False)[:, :count]


def _correlation(one: Tensor, other: Tensor) -> Tensor:
    """Of values that are so far apart in Psi: the Fourier transform of a triangle from -1 to 1."""
    return torch.sinc((one[:, None] - other) / (2 * math.pi)).square()


@lru_cache(maxsize=1024)
def _places(half: float, error: float) -> tuple[float, ...]:
    """Nodes for Psi from -half to half, between -1 and 1."""
    too_few, enough = 0, 1
    while not _known(enough, half, error):
        too_few, enough = enough, max(2 * enough, math.ceil(2 * half / math.pi)) if enough < 8 else enough + 8
    while enough - too_few > 1:
        count = (too_few + enough) // 2
        too_few, enough = (too_few, count) if _known(count, half, error) else (count, enough)
    return tuple(_spread(enough, error).tolist())


def _known(count: int, half: float, error: float) -> bool:
    """Whether this many nodes tell what lies between them. They are symmetric: half of them are looked at."""
    if count < fewest_nodes(-half, half, 1):
        return False
    nodes = half * _spread(count, error)
    between = torch.linspace(0, half, CHECKS * count // 2 + 1, dtype=torch.float64)
    weights = _weights(between, nodes)
    captured = weights * (2 * _correlation(between, nodes) - weights @ _correlation(nodes, nodes))
    return float((1 - captured.sum(1)).max()) <= error**2


def _spread(count: int, error: float) -> Tensor:
    """This many places from -1 to 1, both ends among them, a little closer there (D. Kosloff and H. Tal-Ezer,
    J. Comput. Phys. 104, 457, 1993, with the parameter that suits an error)."""
    if count == 1:
        return torch.zeros(1, dtype=torch.float64)
    steps = torch.arange(count, dtype=torch.float64) / (count - 1) - 0.5
    chebyshev = torch.sin(math.pi * steps)
    bend = 1 / math.cosh(math.log(1 / error) / count)
    return torch.asin(bend * chebyshev) / math.asin(bend)
