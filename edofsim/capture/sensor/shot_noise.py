"""Shot noise: light comes in electrons."""

from __future__ import annotations

from typing import Literal

import torch

from ...recipe.base import Positive
from .base import SensorEffect, Signal


class ShotNoise(SensorEffect):
    """Poisson counts of this many electrons at full scale. Gradients pass as if there were no noise."""

    kind: Literal["shot-noise"] = "shot-noise"
    full_well_electrons: Positive
    """electrons at full scale"""

    def act(self, signal: Signal, generator: torch.Generator) -> Signal:
        image = signal.image
        # a Poisson count replaces the signal; it is not added to it
        electrons = image.detach().double().cpu().clamp_min(0) * self.full_well_electrons
        counts = torch.poisson(electrons, generator=generator) / self.full_well_electrons
        return Signal(image + (counts.to(image) - image.detach()), signal.seen)

    def variance(self, light: torch.Tensor) -> torch.Tensor:
        return light.clamp_min(0) / self.full_well_electrons
