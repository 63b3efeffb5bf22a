"""What photographs have in common: how strong their details are, and how alike in all colours.

Linear filters, and the likelihood of a blur, need no more than these second moments. Measured on the
photographs of BSDS500's training part and of Sun and Hays, 8-bit values taken as intensities.
"""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional

COARSEST_PX = 300.0  # below this frequency the spectrum of photographs is taken as level
FALL = 2.5  # their power spectrum falls with this power of the frequency,
POWER = 2.7e-4  # and this is its size at one cycle a pixel, full scale 1
# correlation of differences between neighbouring pixels
COLOUR_CORRELATION = ((1.0, 0.985, 0.972), (0.985, 1.0, 0.985), (0.972, 0.985, 1.0))


def power_spectrum(size: int, like: Tensor) -> Tensor:
    """Power spectrum of photographs on the half plane of frequencies, [y, x // 2 + 1], for a transform whose
    inverse divides by the number of pixels. After Field, JOSA A 4, 1987: a power of the frequency.

    like: any shape [...]: whose type and device the spectrum has.
    size: pixels along a side.
    """
    fy = torch.fft.fftfreq(size, device=like.device)[:, None]
    fx = torch.fft.rfftfreq(size, device=like.device)[None, :]
    return (POWER * (fy.square() + fx.square() + COARSEST_PX**-2) ** (-FALL / 2)).to(like.dtype)


def transfer_functions(psf: Tensor, size: int) -> Tensor:
    """Transfer functions of PSFs, [depth, channel, size, size // 2 + 1].

    psf: [depth, channel, y, x].
    size: period in pixels, at least the PSFs'.

    Light beyond the PSFs' window is veiling glare, the same all over a photo: its mean passes whole.
    """
    window = psf.shape[-1]
    padded = functional.pad(psf, (0, size - window, 0, size - window))
    transfer = torch.fft.rfft2(torch.roll(padded, (-(window // 2), -(window // 2)), (-2, -1)))
    mean = torch.zeros(transfer.shape[-2:], dtype=torch.bool, device=psf.device)
    mean[0, 0] = True
    return torch.where(mean, torch.ones((), dtype=transfer.dtype, device=psf.device), transfer)
