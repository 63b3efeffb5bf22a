"""Patches through the optics: one plane, one depth, one convolution a patch, as Akpinar et al. train."""

from __future__ import annotations

import torch
from scipy.fft import next_fast_len
from torch import Tensor


def surroundings(window: int) -> tuple[int, int]:
    """Pixels (before, after) that a patch needs around it so that all its light is known: a PSF window of
    `window` pixels has its centre at index window // 2."""
    return window - 1 - window // 2, window // 2


def truncated_light(psf: Tensor) -> Tensor:
    """The fraction of the light of something white that leaves the PSFs' window, [batch, channel].

    psf: [batch, channel, w, w] or [batch, channel, band, w, w], as of `capture_planes`.
    """
    inside = psf.sum((-1, -2))
    return 1 - (inside.sum(-1) if psf.ndim == 5 else inside)


def capture_planes(sharp: Tensor, psf: Tensor, mean: Tensor | None = None) -> Tensor:
    """The noise-free photo of planes, each at its own depth.

    sharp: [batch, band, y + w - 1, x + w - 1], the patch with its `surroundings`.
    psf: [batch, band, w, w], the fraction of light that lands in each pixel; or [batch, channel, band, w, w],
        of each band in each channel.

    Returns [batch, band, y, x]: only pixels whose light is all known, so that nothing wraps or is missing
    (Eq. `Forwardmodel`).

    Light that leaves the PSFs' window is not gone. What height errors scatter spreads over a thousand pixels
    and more, nearly evenly: it comes back as veiling glare, the mean of the picture over all of it.

    mean: [batch, band], of the picture that a patch is from; None for the mean of `sharp`.
    """
    rows, columns = sharp.shape[-2:]
    window = psf.shape[-1]
    size = (next_fast_len(rows, real=True), next_fast_len(columns, real=True))
    spectrum, transfer = torch.fft.rfft2(sharp, s=size), torch.fft.rfft2(psf, s=size)
    mixed = psf.ndim == 5
    spectrum = (transfer * spectrum[:, None]).sum(2) if mixed else transfer * spectrum
    direct = torch.fft.irfft2(spectrum, s=size)[..., window - 1 : rows, window - 1 : columns]
    glare = sharp.mean((-1, -2), keepdim=True) if mean is None else mean[..., None, None]
    inside = psf.sum((-1, -2), keepdim=True)
    return direct + glare - ((inside * glare[:, None]).sum(2) if mixed else inside * glare)
