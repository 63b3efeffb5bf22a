"""What is known of an image before it is seen: how much light, at which scales, in which bands.

An image is modelled as full-scale 1 with the mean and standard deviation of a well-exposed photograph, a
power spectrum that falls with the square of frequency (Field 1987; van der Schaaf and van Hateren 1996), and
bands of which half of the variance is common to all, the other half correlated over `COLOUR_NM`. Photographs
of grey and of vividly coloured things then both stay within a factor of two (3 dB) of what is predicted.
"""

from __future__ import annotations

import torch
from torch import Tensor

MEAN = 0.4
DEVIATION = 0.25
OCTAVES = 8
"""Octaves of scale in an image of some 512 pixels, from the frame's width to two pixels."""
COMMON = 0.5
COLOUR_NM = 50.0


def image_power(rows: int, columns: int) -> Tensor:
    """Expected power of an image at the frequencies of rfft2: float64 [rows, columns // 2 + 1].

    Counted so that sum(power * |error spectrum|^2) over the half-spectrum is the mean square error of the
    image that a kernel with that error spectrum makes. Scales wider than the window go to zero frequency.
    """
    fy = torch.fft.fftfreq(rows, dtype=torch.float64)[:, None]
    fx = torch.fft.rfftfreq(columns, dtype=torch.float64)[None, :]
    frequency = torch.hypot(fy, fx)
    # columns of rfft2 other than the first (and, for an even width, the last) stand for two frequencies
    twice = torch.full((1, fx.numel()), 2.0, dtype=torch.float64)
    twice[0, 0] = 1
    if columns % 2 == 0:
        twice[0, -1] = 1
    inside = min(1.0, torch.log2(torch.tensor(float(max(min(rows, columns), 2)))).item() / OCTAVES)
    power = torch.zeros_like(frequency)
    power[frequency > 0] = frequency[frequency > 0] ** -2
    power = power * twice
    power = power * (inside * DEVIATION**2 / power.sum().clamp_min(1e-300))
    power[0, 0] = MEAN**2 + (1 - inside) * DEVIATION**2
    return power


def band_correlation(wavelengths: Tensor) -> Tensor:
    """Correlation of an image's bands, float64 [band, band], for wavelengths in metres."""
    nm = wavelengths.double() * 1e9
    return COMMON + (1 - COMMON) * torch.exp(-(nm[:, None] - nm[None, :]).abs() / COLOUR_NM)
