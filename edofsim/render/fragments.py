"""What rendering makes and a file holds of a view: numpy arrays, for which PyTorch need not be loaded."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .fragment_fields import FragmentFields


@dataclass(frozen=True)
class Fragments(FragmentFields[np.ndarray]):
    """A view's fragments before any photo is taken of them.

    pixel: int64 [fragment]; coverage, inverse_depth: float32 [fragment]; radiance: float32 [band, fragment];
    hidden: bool [fragment]; wavelengths: float64 [band], metres; half_difference: float32 [band, fragment].
    """

    @property
    def bands(self) -> int:
        return len(self.wavelengths)

    def all_in_focus(self) -> np.ndarray:
        """As `View.all_in_focus`, float32 [band, y, x]."""
        seen = np.flatnonzero(~self.hidden)
        image = np.zeros((self.bands, *self.padded_shape), np.float32)
        for flat, radiance in zip(image.reshape(self.bands, -1), self.radiance, strict=True):
            np.add.at(flat, self.pixel[seen], radiance[seen])
        return image

    def mean_inverse_depth(self) -> np.ndarray:
        """As `View.mean_inverse_depth`, float32 [y, x]."""
        total, weight = (np.zeros(self.padded_shape, np.float32) for _ in range(2))
        seen = self.coverage * ~self.hidden
        np.add.at(total.reshape(-1), self.pixel, seen * self.inverse_depth)
        np.add.at(weight.reshape(-1), self.pixel, seen)
        return total / np.maximum(weight, np.finfo(np.float32).tiny)
