"""Masks that learn: from trainable values to the height map of the DOE."""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn


class FreeHeight(nn.Module):
    """A height of its own for each sample of the mask, held between 0 and what can be made.

    What learns is a phase in radians at the design wavelength, as in Akpinar et al.; the height follows
    it with slope one around the middle and levels off towards the limits, so that every step of the
    optimiser changes the mask and none leaves the range.

    start: [n, n] in metres, anywhere in [0, limit].
    limit: metres.
    radian: metres of height that delay the design wavelength by one radian.
    """

    def __init__(self, start: Tensor, limit: float, radian: float) -> None:
        super().__init__()
        self.limit = limit
        self.reach = limit / radian / 4
        # a map that touches its limits starts just inside them, where the slope is not yet zero
        share = (start.to(torch.float32) / limit).clamp(0.02, 0.98)
        self.phase = nn.Parameter(self.reach * torch.logit(share))

    def forward(self) -> Tensor:
        """The height map, [n, n] in metres."""
        return self.limit * torch.sigmoid(self.phase / self.reach)


class FixedHeight(nn.Module):
    """A mask that does not learn.

    height: [n, n] in metres.
    """

    def __init__(self, height: Tensor) -> None:
        super().__init__()
        self.register_buffer("height", height.to(torch.float32), persistent=False)

    def forward(self) -> Tensor:
        return self.height


class NoHeight(nn.Module):
    """A camera whose mask, if any, has no height map."""

    def forward(self) -> None:
        return None


def metres_per_radian(index: float, wavelength: float) -> float:
    """Height of a material of refractive index `index` that delays `wavelength` [m] by a radian
    (Eq. `dtophi` turned round)."""
    return wavelength / (2 * math.pi * (index - 1))
