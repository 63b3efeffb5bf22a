"""Quantisation: the converter knows this many steps."""

from __future__ import annotations

from typing import Annotated, Literal

import torch
from pydantic import Field

from .base import SensorEffect, Signal


class Quantisation(SensorEffect):
    """Rounds to whole steps of a converter of this many bits, which clips at 0 and at full scale. Gradients
    pass as if it did not round."""

    kind: Literal["quantisation"] = "quantisation"
    bits: Annotated[int, Field(ge=1, le=24)]
    """bits of the converter"""

    def act(self, signal: Signal, generator: torch.Generator) -> Signal:
        image, steps = signal.image.clamp(0, 1), 2**self.bits - 1
        return Signal(image + ((image.detach() * steps).round() / steps - image.detach()), signal.seen)

    def variance(self, light: torch.Tensor) -> torch.Tensor:
        return torch.full_like(light, 1 / (2**self.bits - 1) ** 2 / 12)
