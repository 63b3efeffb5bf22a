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
    """mean of each pixel"""
    full_well_electrons: Positive
    """electrons at full scale"""
    noise: bool = True
    """False: each pixel has the mean"""

    def act(self, signal: Signal, generator: torch.Generator) -> Signal:
        dark = torch.full(signal.image.shape, self.electrons, dtype=torch.float64)
        dark = torch.poisson(dark, generator=generator) if self.noise else dark
        return Signal(signal.image + (dark / self.full_well_electrons).to(signal.image), signal.seen)

    def variance(self, light: torch.Tensor) -> torch.Tensor:
        return torch.full_like(light, self.noise * self.electrons / self.full_well_electrons**2)
