"""What a sensor effect is asked for. A new kind is a class in a file of its own, and a line in the
registry."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import torch
from torch import Tensor

from ...recipe.kinds import SENSOR_EFFECTS, KindModel, NameOf


@dataclass(frozen=True)
class Signal:
    """An exposed image on its way through the sensor, [..., channel, y, x], full scale 1.

    seen: 1 where a pixel sees a channel, else 0, [channel, y, x], None where every pixel sees every channel.
    """

    image: Tensor
    seen: Tensor | None = None


class SensorEffect(KindModel):
    """Something that the sensor does to an exposed image."""

    before: Annotated[str, NameOf(SENSOR_EFFECTS)] | None = None
    """kind of the effect that it acts right before, such as "quantisation"; without it, or where the sensor
    has no such effect, it acts after all others that there are by then"""

    def act(self, signal: Signal, generator: torch.Generator) -> Signal:
        """The signal after the effect.

        generator: of everything random, on the CPU, so that the same seed gives the same noise on every
            device; gradients pass where the effect lets them.
        signal: the image before the effect.
        """
        raise NotImplementedError

    def variance(self, light: torch.Tensor) -> torch.Tensor:
        """Of the noise that the effect adds to exposed light, in its shape; 0 where it adds none.

        light: any shape [...], exposed, full scale 1.
        """
        return torch.zeros_like(light)
