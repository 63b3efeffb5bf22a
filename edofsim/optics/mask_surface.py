"""The height map of a mask in the stop, as rays meet it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import torch
from torch import Tensor

from .grid import NO_WRAPS, PupilGrid, sampled_at


@dataclass(frozen=True, eq=False)
class MaskSurface:
    """Heights [samples, samples] in metres on a grid of the pupil.

    wave: height [m] of one wave: steps of more than half of it are wraps, which bend nothing.
    index: of what the mask is made of, at the wavelength of the rays.
    """

    grid: PupilGrid
    height: Tensor
    wave: float
    index: float

    def at(self, u: Tensor, v: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Height [m], and what it grows by to the right and up [m per radius].

        u, v: any shape [...], in radii.
        """
        height = sampled_at(self.height, self.grid, u, v, self.wave)
        right, up = sampled_at(self._slopes, self.grid, u, v, NO_WRAPS)
        return height, right, up

    def lifted(self, squared: Tensor | float) -> Tensor:
        """Path for each metre of height, of rays that meet the stop at an angle: n cos t' - cos t.

        squared: sine of the angle in air, squared, any shape [...].
        """
        squared = torch.as_tensor(squared, dtype=torch.float64)
        return torch.sqrt(self.index**2 - squared) - torch.sqrt(1 - squared)

    @cached_property
    def _slopes(self) -> Tensor:
        found = []
        for axis, way in ((1, 1.0), (0, -1.0)):
            step = self.height.diff(dim=axis)
            step = step - (step / self.wave).round() * self.wave
            ends = step.narrow(axis, 0, 1), step.narrow(axis, -1, 1)
            both = torch.cat([ends[0], step], axis) + torch.cat([step, ends[1]], axis)
            found.append(both * (way * self.grid.radius / (2 * self.grid.pitch)))
        return torch.stack(found)
