"""What a mask at the pupil is asked for. A new kind is a class in a file of its own that says the rest.

Coordinates are those of the pupil seen from the sensor towards the scene, normalised by its radius: u to the
right, v up, rho^2 = u^2 + v^2 <= 1. A phase is given in radians at `design_wavelength_nm`; the mask is then a
height of `material` above its substrate, and the phase at every other wavelength follows from that height and
the material's dispersion (Akpinar et al., Eqs. `dtophi` and `phi0tophi`).
"""

from __future__ import annotations

from typing import Annotated

import torch
from pydantic import Field
from torch import Tensor, nn

from ...core.once import Once
from ...recipe.base import Positive
from ...recipe.kinds import KindModel
from ..grid import PupilGrid

Finite = Annotated[float, Field(ge=-1e4, le=1e4)]
SLOPE_SAMPLES = 512
"""Steps across the pupil that the steepest phase is looked for in."""


class Mask(KindModel):
    """A mask at the pupil of a camera recipe; as it stands, one that changes nothing."""

    def transmission(self, grid: PupilGrid) -> tuple[Tensor, Tensor] | None:
        """What it lets through in each cell within the aperture, (amplitude samples, light), float64
        [samples, samples], see `mask_amplitude`; None where it blocks nothing.

        grid: cells of the pupil.
        """
        return None

    def phase(self, grid: PupilGrid) -> Tensor | None:
        """Phase [rad] at the design wavelength, float64 [samples, samples]; None for masks without a formula
        for it. Cells that an edge of a stepped mask crosses get the mean phase.

        grid: cells of the pupil.
        """
        return None

    def regions(self, grid: PupilGrid) -> list[tuple[Tensor, float]]:
        """(amplitude [samples, samples], phase [rad] at the design wavelength) of each level of a stepped
        mask: the wave is the sum over regions, so that an edge is as sharp as the grid can show. Empty for
        other masks.

        grid: cells of the pupil.
        """
        return []

    def slope(self) -> float:
        """Steepest phase of a smooth mask within the pupil [rad per pupil radius] at the design wavelength.

        0 for masks without phase and for stepped ones, whose edges are as sharp as the grid shows them."""
        return 0.0

    def learner(self, grid: PupilGrid, radian: float) -> nn.Module | None:
        """A module without inputs that gives the height map [samples, samples] in metres, up to a piston, and
        whose parameters learn; None for a mask that cannot.

        radian: metres of height for a radian of phase at the design wavelength.
        grid: cells of the pupil.
        """
        return None

    def files(self) -> tuple[str, ...]:
        """Files, relative to the recipe's folder, whose content is part of the mask."""
        return ()


_slopes = Once()


class PhaseMask(Mask):
    """What all transparent masks share: what they are made of and where their phase is stated."""

    material: str = "S1813"
    """material of the mask"""
    design_wavelength_nm: Positive = 543.0
    """wavelength at which the phase is stated, nm"""


class SmoothMask(PhaseMask):
    """A transparent mask whose phase has a formula."""

    def wavefront(self, u: Tensor, v: Tensor) -> Tensor:
        """Phase [rad] at the design wavelength at (u, v), which broadcast, float64.

        u: to the right, in pupil radii; broadcasts with v, such as [1, n].
        v: up, in pupil radii, such as [n, 1].
        """
        raise NotImplementedError

    def phase(self, grid: PupilGrid) -> Tensor:
        return self.wavefront(*grid.normalised())

    def slope(self) -> float:
        return _slopes.get((type(self), self.model_dump_json()), self._slope)

    def _slope(self) -> float:
        axis = torch.linspace(-1, 1, SLOPE_SAMPLES + 1, dtype=torch.float64)
        u, v = axis[None, :], axis.flip(0)[:, None]
        phase = torch.where(u**2 + v**2 <= 1, self.wavefront(u, v), torch.nan)
        steps = torch.cat([phase.diff(dim=0).flatten(), phase.diff(dim=1).flatten()]).abs()
        return float(steps.nan_to_num(0).max()) / float(axis[1] - axis[0])
