"""A sensor effect: a level that the sensor shows in the dark."""

from __future__ import annotations

from typing import Literal

import torch

from edofsim.plugins import NotNegative, SensorEffect, Signal


class DarkLevel(SensorEffect):
    """Adds a level, relative to full scale."""

    kind: Literal["dark-level"] = "dark-level"
    level: NotNegative = 0.01

    def act(self, signal: Signal, generator: torch.Generator) -> Signal:
        return Signal(signal.image + self.level, signal.seen)
