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
    spectrum = _power(size)
    return torch.fft.rfft2(psf) * (spectrum / spectrum.sum()).sqrt()


def transfers_apart(one: Tensor, other: Tensor, of_all: bool = False) -> float:
    """How pictures differ that such transfer functions make, in the root mean square relative to the
    contrast, in the worst PSF.

    one: [..., y, x // 2 + 1], of `contrast_transfer`.
    other: the same, [..., y, x // 2 + 1].
    of_all: a mean over all PSFs, in place of the worst.
    """
    squares = (one - other).abs().square().sum((-1, -2))
    return float((squares.mean() if of_all else squares.max()).sqrt())


class Contrast:
    """PSFs as what they do to a picture whose power falls with the square of the frequency. mean: of the
    picture, over the root mean square of its contrast."""

    def __init__(self, size: int, dtype: torch.dtype, mean: float) -> None:
        power = _power(size)
        self._both = torch.full_like(power, 2.0)  # a frequency and its opposite
        self._both[:, 0] = 1
        if size % 2 == 0:
            self._both[:, -1] = 1
        power = power / (power * self._both).sum()
        power[0, 0] = mean**2
        self._both, self._weight = self._both.to(dtype), (power * self._both).sqrt().to(dtype)
        self._size = size

    def seen(self, psfs: Tensor) -> Tensor:
        """[n, number] of PSFs [n, y, x].

        psfs: [n, y, x].
        """
        return torch.view_as_real(torch.fft.rfft2(psfs).mul_(self._weight)).flatten(1)

    def kernels(self, seen: Tensor) -> Tensor:
        """[n, y, x]: what `seen` came from.

        seen: [n, number].
        """
        return self._back(seen, 1 / self._weight)

    def duals(self, seen: Tensor) -> Tensor:
        """[n, y, x], whose products with a PSF are those of `seen` with what is seen of it.

        seen: [n, number].
        """
        return self._back(seen, self._weight / self._both) * self._size**2

    def _back(self, seen: Tensor, weight: Tensor) -> Tensor:
        parts = torch.view_as_complex(seen.reshape(len(seen), self._size, -1, 2).contiguous())
        return torch.fft.irfft2(parts * weight, s=(self._size, self._size))


def _power(size: int) -> Tensor:
    """Power of a picture by frequency, [y, x // 2 + 1], any scale; nothing at 0: light is kept."""
    fy, fx = torch.fft.fftfreq(size)[:, None], torch.fft.rfftfreq(size)[None, :]
    power = 1 / (fy.square() + fx.square())
    power[0, 0] = 0
    return power
