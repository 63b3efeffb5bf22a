"""What lies behind the halo of a highlight: as smooth as what is blurred."""

from __future__ import annotations

import math

import torch
from torch import Tensor

WAVES = 10
"""Cosines along each axis."""
CONTRAST = 1.0
"""Likely size of the slowest, relative to the contrast of the photo away from the halo;"""
FALL = 1.5
"""the power of the frequency by which those of faster ones fall,"""
PERIOD_PX = 256.0
"""from half this period on."""
ROUGH, NOISE = 0.05, 1.2
"""What no cosine describes: so much of that contrast, and of the noise."""
AWAY_PX = 24.0
"""From here on there is little of the halo."""


def background(light: Tensor, away: Tensor, noise: float, scale: int = 1) -> tuple[Tensor, Tensor]:
    """Cosines [wave, y * x], and what keeps each small, [wave]: the deviation that no cosine describes over
    its own likely one.

    light: [3, y, x], full scale 1.
    away: [y, x], pixels of the photo from what is full.
    noise: standard deviation of the light's.
    scale: pixels of the photo to one of the light's.
    """
    rows, columns = light.shape[-2:]
    outside = light[:, away >= min(AWAY_PX, 0.7 * float(away.max()))].clamp_max(1)
    contrast = float((outside.var(1, correction=0).mean() - noise**2).clamp_min(1e-6).sqrt())
    wave = torch.arange(WAVES, dtype=light.dtype)
    down, across = (
        torch.cos(math.pi * wave[:, None] * (torch.arange(n, dtype=light.dtype) + 0.5) / n)
        for n in (rows, columns)
    )
    cosines = (down[:, None, :, None] * across[None, :, None, :]).flatten(2).flatten(0, 1)
    frequency = PERIOD_PX / (2 * scale) * (wave / rows)[:, None].hypot(wave / columns).flatten()
    likely = CONTRAST * contrast / frequency.clamp_min(0.5) ** FALL
    likely[0] = 1.0  # the mean may be anything
    return cosines, (NOISE * noise + ROUGH * contrast) / likely
