"""Saturation: a pixel that is full shows no more."""

from __future__ import annotations

from typing import Literal

import torch

from .base import SensorEffect, Signal


class Saturation(SensorEffect):
    """Clips at 0 and at full scale."""

    kind: Literal["saturation"] = "saturation"

    def act(self, signal: Signal, generator: torch.Generator) -> Signal:
        return Signal(signal.image.clamp(0, 1), signal.seen)
