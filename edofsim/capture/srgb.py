"""The transfer curve of sRGB, for pictures that people look at and for experiments on encoded values."""

from __future__ import annotations

import torch
from torch import Tensor


def srgb_encode(linear: Tensor) -> Tensor:
    """Transfer curve of sRGB (IEC 61966-2-1): linear in, encoded out, both clipped to [0, 1]."""
    x = linear.clamp(0, 1)
    return torch.where(x <= 0.0031308, 12.92 * x, 1.055 * x.clamp_min(0.0031308) ** (1 / 2.4) - 0.055)
