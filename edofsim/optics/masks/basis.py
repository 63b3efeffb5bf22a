"""Phases that are sums of given shapes, and the same with coefficients that learn."""

from __future__ import annotations

from collections.abc import Iterator

import torch
from torch import Tensor, nn

from ..grid import PupilGrid
from .base import SmoothMask


class BasisMask(SmoothMask):
    """A transparent mask whose phase is a sum of shapes, each with a coefficient that can learn."""

    def shapes(self, u: Tensor, v: Tensor) -> Iterator[tuple[float, Tensor]]:
        """(coefficient [rad], phase at (u, v) for a coefficient of one radian) of each shape, float64.

        u: to the right, in pupil radii; broadcasts with v, such as [1, n].
        v: up, in pupil radii, such as [n, 1].
        """
        raise NotImplementedError

    def wavefront(self, u: Tensor, v: Tensor) -> Tensor:
        flat = torch.zeros_like(u + v)
        return sum((coefficient * shape for coefficient, shape in self.shapes(u, v)), flat)

    def learner(self, grid: PupilGrid, radian: float) -> nn.Module:
        coefficients, shapes = zip(*self.shapes(*grid.normalised()), strict=True)
        return BasisHeight(torch.stack(shapes) * radian, torch.tensor(coefficients))


class BasisHeight(nn.Module):
    """A sum of given shapes: Zernike polynomials or harmonics (Sitzmann et al., 2018).

    basis: [term, n, n] in metres for a coefficient of one radian.
    start: [term] in radians. The sum is shifted to start at height 0, which no photo can tell from another
        start.
    """

    def __init__(self, basis: Tensor, start: Tensor) -> None:
        super().__init__()
        self.register_buffer("basis", basis.to(torch.float32), persistent=False)
        self.phase = nn.Parameter(start.to(torch.float32).clone())

    def forward(self) -> Tensor:
        """The height map, [n, n] in metres."""
        height = torch.einsum("t,tyx->yx", self.phase, self.basis)
        return height - height.detach().amin()
