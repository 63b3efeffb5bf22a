"""Which distances a network is given a camera's PSFs at: closely where the blur is small."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from ..capture.prepare import blur_per_dioptre
from ..optics import Camera
from ..optics.camera import focus_distance

FINEST_PX = 0.5
"""Blurs of neighbouring depths differ by so much about the focus, where evenly spaced ones differ more."""
GREEN = 543e-9


def closer_about_focus(camera: Camera, inverse_depths: Tensor) -> Tensor:
    """Inverse depths [depth] in 1/m, evenly spaced and ascending, moved towards the focus of a lens with a
    large blur: there few pixels of it make all the difference, far from it nothing can be distinguished.

    inverse_depths: [depth], 1/m, ascending.

    Of a lens with a small blur they stay. Otherwise they are even in asinh(d / b), d the diameter of the
    geometric blur and b as wide as keeps steps about the focus at `FINEST_PX`.
    """
    focus = 1 / float(focus_distance(camera, GREEN))
    per_dioptre = blur_per_dioptre(camera)
    blur = (inverse_depths - focus) * per_dioptre
    first, last = float(blur[0]), float(blur[-1])
    steps = max(1, len(blur) - 1)
    if (last - first) / steps <= FINEST_PX:
        return inverse_depths
    low, high = 1e-6, abs(last - first)
    for _ in range(60):  # steps about the focus grow with b
        width = math.sqrt(low * high)
        ends = math.asinh(first / width), math.asinh(last / width)
        if width * (ends[1] - ends[0]) / steps < FINEST_PX:
            low = width
        else:
            high = width
    even = torch.linspace(*ends, len(blur), dtype=torch.float64)
    return focus + width * even.sinh() / per_dioptre
