"""From light on the sensor to numbers: exposure, saturation, noise, quantisation, Bayer mosaic."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import torch
from torch import Tensor

from ..errors import InputError

Bayer = Literal["RGGB", "BGGR", "GRBG", "GBRG"]

WHITE_PERCENTILE = 99.5
WHITE_LEVEL = 0.9
"""Automatic exposure puts the 99.5th percentile of the ideal image, over all channels, at 0.9."""
ROOM = 1e-3
"""Part of a precision's range that exposed images may fill: sums over pixels must fit into it too."""


@dataclass(frozen=True)
class SensorEffects:
    """What the sensor does to an exposed image; everything is off by default. Full scale is 1.

    saturation: clip at 0 and full scale; full_well: electrons at full scale, for the shot noise of that many
    (None: no shot noise); read_noise: standard deviation of Gaussian noise, sigma_s of the paper's
    Eq. `SensorImage`; bits: quantisation (None: none), which implies saturation; bayer: colour of the
    mosaic's top left 2 x 2 pixels (None: every pixel sees every channel).
    """

    saturation: bool = False
    full_well: float | None = None
    read_noise: float = 0.0
    bits: int | None = None
    bayer: Bayer | None = None

    def __post_init__(self) -> None:
        problems = []
        if not self.read_noise >= 0:
            problems.append(f"read noise {self.read_noise}: give a standard deviation of 0 or more")
        if self.full_well is not None and not self.full_well > 0:
            problems.append(f"full well of {self.full_well} electrons: give a positive number")
        if self.bits is not None and not 1 <= self.bits <= 24:
            problems.append(f"{self.bits} bits a pixel: give 1 to 24")
        if self.bayer is not None and self.bayer not in ("RGGB", "BGGR", "GRBG", "GBRG"):
            problems.append(f"Bayer pattern {self.bayer!r}: give RGGB, BGGR, GRBG or GBRG")
        if problems:
            raise InputError(problems)


def automatic_exposure(ideal: Tensor) -> float:
    """Factor from radiance to full scale for an ideal image of any shape; 1 where the image is black.

    Smaller where a photo of so little light, or of a lamp in it, would not fit into the image's precision.
    """
    values = ideal.detach().flatten()
    index = min(values.numel() - 1, round(WHITE_PERCENTILE / 100 * (values.numel() - 1)))
    white = float(torch.kthvalue(values, index + 1).values)  # torch.quantile refuses large images
    if not white > 0:
        return 1.0
    room = ROOM * torch.finfo(values.dtype).max / max(float(values.max()), 1.0)
    return min(WHITE_LEVEL / white, room)


def record(clean: Tensor, effects: SensorEffects, seed: int) -> Tensor:
    """Add what the sensor does to noise-free exposed images [..., channel, y, x]; same shape.

    Order: mosaic, shot noise, read noise, saturation, quantisation. Gradients pass through the noise and the
    mosaic, and through quantisation as if it were not there. The same seed gives the same noise on every
    device: it is drawn on the CPU, in float64.
    """
    generator = torch.Generator().manual_seed(seed)
    image = clean
    if effects.bayer:
        image = image * _mosaic(clean, effects.bayer)
    if effects.full_well:
        # a Poisson count replaces the signal; it is not added to it
        electrons = image.detach().double().cpu().clamp_min(0) * effects.full_well
        counts = torch.poisson(electrons, generator=generator) / effects.full_well
        image = image + (counts.to(image) - image.detach())
    if effects.read_noise:
        noise = torch.randn(clean.shape, generator=generator, dtype=torch.float64) * effects.read_noise
        noise = noise.to(image)
        image = image + (noise * _mosaic(clean, effects.bayer) if effects.bayer else noise)
    if effects.saturation or effects.bits:
        image = image.clamp(0, 1)
    if effects.bits:
        steps = 2**effects.bits - 1
        image = image + ((image.detach() * steps).round() / steps - image.detach())
    return image


def _mosaic(image: Tensor, pattern: str) -> Tensor:
    """1 where a pixel sees a channel, else 0: [3, y, x]. The pattern's four letters are two rows of two."""
    channels, rows, columns = image.shape[-3:]
    if channels != 3:
        raise InputError(f"a Bayer mosaic needs 3 channels, not {channels}: turn it off for this response")
    seen = image.new_zeros(3, rows, columns)
    for k, colour in enumerate(pattern):
        seen["RGB".index(colour), k // 2 :: 2, k % 2 :: 2] = 1
    return seen
