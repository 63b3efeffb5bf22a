"""How pictures differ that PSFs make, by the contrast of a picture."""

from __future__ import annotations

import math

import torch
from torch import Tensor
from torch.nn import functional

WIDEST_PX = 256
"""PSFs in wider windows are compared in larger pixels: their transforms would take much memory."""
CONTRAST_DB = 12.0
"""PSNR less the ratio of a picture's contrast to an error: its contrast is a quarter of full scale."""


def contrast_transfer(psf: Tensor) -> Tensor:
    """Transfer functions [..., y, x // 2 + 1] of PSFs [..., y, x], each frequency by its share of the
    contrast of a picture whose power spectrum falls with the square of the frequency; nothing at 0.

    psf: [..., y, x].
    """
    psf = functional.avg_pool2d(psf, math.ceil(psf.shape[-1] / WIDEST_PX), divisor_override=1)
    size = psf.shape[-1]
    fy, fx = torch.fft.fftfreq(size)[:, None], torch.fft.rfftfreq(size)[None, :]
    spectrum = 1 / (fy.square() + fx.square())
    spectrum[0, 0] = 0  # light is kept
    return torch.fft.rfft2(psf) * (spectrum / spectrum.sum()).sqrt()


def transfers_apart(one: Tensor, other: Tensor) -> float:
    """How pictures differ that such transfer functions make, in the root mean square relative to the
    contrast, in the worst PSF.

    one: [..., y, x // 2 + 1], of `contrast_transfer`.
    other: the same, [..., y, x // 2 + 1].
    """
    return float((one - other).abs().square().sum((-1, -2)).max().sqrt())
