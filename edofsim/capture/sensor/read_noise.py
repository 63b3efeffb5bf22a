"""Read noise: Gaussian, the same at every brightness."""

from __future__ import annotations

from typing import Literal

import torch

from ...recipe.base import NotNegative
from .base import SensorEffect, Signal


class ReadNoise(SensorEffect):
    """Standard deviation relative to full scale, sigma_s of Akpinar et al., Eq. `SensorImage`."""

    kind: Literal["read-noise"] = "read-noise"
    deviation: NotNegative
    """standard deviation, relative to full scale"""

    def act(self, signal: Signal, generator: torch.Generator) -> Signal:
        image, seen = signal.image, signal.seen
        noise = torch.randn(image.shape, generator=generator, dtype=torch.float64) * self.deviation
        noise = noise.to(image)
        return Signal(image + (noise if seen is None else noise * seen), seen)

    def variance(self, light: torch.Tensor) -> torch.Tensor:
        return torch.full_like(light, self.deviation**2)
