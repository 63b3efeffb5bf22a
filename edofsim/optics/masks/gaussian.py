"""The Gaussian apodiser."""

from __future__ import annotations

from typing import Annotated, Literal

import torch
from pydantic import Field
from torch import Tensor

from ..grid import PupilGrid
from .base import Mask


class GaussianMask(Mask):
    """Amplitude exp(-rho^2 / waist^2), `waist` as a fraction of the pupil's radius: an apodiser.

    J. Ojeda-Castaneda, P. Andres, A. Diaz, "Annular apodizers for low sensitivity to defocus and to spherical
    aberration", Opt. Lett. 11, 487 (1986), discusses such amplitude masks for depth of field.
    """

    kind: Literal["gaussian"] = "gaussian"
    waist: Annotated[float, Field(gt=0, le=100)] = 0.7
    """radius at which the amplitude is 1/e, as a fraction of the pupil's"""

    def transmission(self, grid: PupilGrid) -> tuple[Tensor, Tensor]:
        amplitude = torch.exp(-grid.radius_squared() / (self.waist * grid.radius) ** 2)
        return amplitude, amplitude**2
