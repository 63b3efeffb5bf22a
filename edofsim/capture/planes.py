"""Patches through the optics: one plane, one depth, one convolution a patch, as Akpinar et al. train."""

from __future__ import annotations

import torch
from scipy.fft import next_fast_len
from torch import Tensor


def surroundings(window: int) -> tuple[int, int]:
    """Pixels (before, after) that a patch needs around it so that all its light is known: a PSF window of
    `window` pixels has its centre at index window // 2."""
    return window - 1 - window // 2, window // 2


def capture_planes(sharp: Tensor, psf: Tensor, mean: Tensor | None = None) -> Tensor:
    """The noise-free photo of planes, each at its own depth.

    sharp: [batch, band, y + w - 1, x + w - 1], the patch with its `surroundings`.
    psf: [batch, band, w, w], the fraction of light that lands in each pixel.

    Returns [batch, band, y, x]: only pixels whose light is all known, so that nothing wraps or is missing
    (Eq. `Forwardmodel`).

    Light that leaves the PSFs' window is not gone. What height errors scatter spreads over a thousand pixels
    and more, nearly evenly: it comes back as veiling glare, the mean of the picture over all of it.

    mean: [batch, band], of the picture that a patch is from; None for the mean of `sharp`.
    """
    rows, columns = sharp.shape[-2:]
    window = psf.shape[-1]
    size = (next_fast_len(rows, real=True), next_fast_len(columns, real=True))
    spectrum = torch.fft.rfft2(sharp, s=size) * torch.fft.rfft2(psf, s=size)
    direct = torch.fft.irfft2(spectrum, s=size)[..., window - 1 : rows, window - 1 : columns]
    outside = 1 - psf.sum((-1, -2), keepdim=True)
    glare = sharp.mean((-1, -2), keepdim=True) if mean is None else mean[..., None, None]
    return direct + outside * glare
