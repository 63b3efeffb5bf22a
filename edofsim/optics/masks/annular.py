"""The annular aperture."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field
from torch import Tensor

from ..grid import PupilGrid, disc_amplitude, disc_coverage
from .base import Mask


class AnnularMask(Mask):
    """A central disc of `inner_radius` (fraction of the pupil's radius) is opaque.

    W. T. Welford, "Use of annular apertures to increase focal depth", J. Opt. Soc. Am. 50, 749 (1960).
    """

    kind: Literal["annular"] = "annular"
    inner_radius: Annotated[float, Field(gt=0, lt=1)] = 0.5
    """radius of the opaque disc, as a fraction of the pupil's"""

    def transmission(self, grid: PupilGrid) -> tuple[Tensor, Tensor]:
        radius = self.inner_radius * grid.radius
        return 1 - disc_amplitude(grid, radius), 1 - disc_coverage(grid, radius)
