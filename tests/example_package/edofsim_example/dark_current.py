"""A sensor effect: electrons of the dark, which the converter sees like those of light."""

from __future__ import annotations

from typing import Literal

import torch

from edofsim.plugins import Positive, SensorEffect, Signal


class DarkCurrent(SensorEffect):
    """Poisson counts of `electrons` in each pixel, of `full_well_electrons` at full scale."""

    kind: Literal["dark-current"] = "dark-current"
    before: Literal["quantisation"] = "quantisation"
    electrons: Positive
    full_well_electrons: Positive

    def act(self, signal: Signal, generator: torch.Generator) -> Signal:
        mean = torch.full(signal.image.shape, self.electrons, dtype=torch.float64)
        dark = torch.poisson(mean, generator=generator) / self.full_well_electrons
        return Signal(signal.image + dark.to(signal.image), signal.seen)

    def variance(self, light: torch.Tensor) -> torch.Tensor:
        return torch.full_like(light, self.electrons / self.full_well_electrons**2)
