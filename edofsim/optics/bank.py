"""PSFs over depth and wavelength, as data."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor

from .sampling import Sampling


@dataclass(frozen=True)
class PsfBank:
    """PSFs in upright-picture orientation, row 0 the top, ready to be convolved with the upright picture.

    values: [depth, band, y, x], energy that lands in each pixel as a fraction of the light that the mask
    lets through, the centre pixel at index n // 2. truncated: [depth, band], the fraction that lands outside
    the window, so that values.sum((-1, -2)) + truncated = 1. transmission: the light that the mask lets
    through as a fraction of what the open aperture would. wavelengths: [band], metres; inverse_depths:
    [depth], 1/m; both float64.
    """

    values: Tensor
    truncated: Tensor
    wavelengths: Tensor
    inverse_depths: Tensor
    transmission: float
    sampling: Sampling
