"""Wiener deconvolution: the linear restoration that the networks are compared with."""

from __future__ import annotations

import torch
from torch import Tensor

from ..core.images import mirrored
from ..errors import InputError
from .borders import continued

BEYOND_PX = 4
"""The filter is given so much of what may lie beyond a photo, see `borders`, before mirror images go on.
Those alone leave lines on borders that bright things lie beyond. Farther out the slope foretells little, and
the filter of a lens without a mask, which raises some frequencies a lot, makes more of the guess."""


def wiener(image: Tensor, psf: Tensor, noise: float | Tensor, beyond_px: int | None = None) -> Tensor:
    """The linear filter with the least mean square error for an unknown depth.

    image: [.., channel, y, x] linear. psf: [channel, y, x], or [depth, channel, y, x] where the depth is one
    of several, equally likely; light that a PSF lacks of 1 is veiling glare; its centre is index n // 2.
    noise: standard deviation relative to full scale 1. beyond_px: pixels that the image is continued by
    beyond its border, before its mirror images go on; None for `BEYOND_PX`. Returns the image's shape.

    With H the transfer function, S the power spectrum of the scene and N that of the noise,
    W = E[H*] S / (E[|H|^2] S + N): the classical filter (Goodman, *Introduction to Fourier Optics*, sec. 8)
    with the mean PSF above, and below the line what depth adds to it. S falls with the square of the
    frequency, as natural images do (Field, JOSA A 4, 1987); its level is read off the photo.

    Raises InputError where channels differ or the noise is negative.
    """
    stack = psf if psf.ndim == 4 else psf[None]
    if stack.ndim != 4 or image.ndim < 3 or stack.shape[1] != image.shape[-3]:
        raise InputError(
            f"Wiener filter: an image {list(image.shape)} and PSFs {list(psf.shape)} do not fit; "
            "give [channel, y, x] and [depth, channel, y, x] with the same channels"
        )
    if not noise >= 0:
        raise InputError(f"Wiener filter: noise must be at least 0, not {noise}")
    beyond_px = BEYOND_PX if beyond_px is None else beyond_px
    padded, (top, left) = _reflected(continued(image, beyond_px), max(stack.shape[-2:]))
    top, left = top + beyond_px, left + beyond_px
    rows, columns = padded.shape[-2:]
    mean, power = _transfer(stack, rows, columns)
    spectrum = torch.fft.rfft2(padded - _level(padded))
    restored = spectrum * mean.conj() / (power + _noise_to_signal(spectrum, power, noise, (rows, columns)))
    # the mean level passes whole: what leaves a PSF's window is veiling glare over all of the photo
    filtered = torch.fft.irfft2(restored, s=(rows, columns)) + _level(padded)
    # the PSFs' centre is not at their first pixel
    top, left = top - stack.shape[-2] // 2, left - stack.shape[-1] // 2
    return filtered[..., top : top + image.shape[-2], left : left + image.shape[-1]]


def _level(image: Tensor) -> Tensor:
    return image.mean((-2, -1), keepdim=True)


def _reflected(image: Tensor, reach: int) -> tuple[Tensor, tuple[int, int]]:
    """The image and its mirror images, at least `reach` pixels on each side, as one period of a periodic
    image without a jump; and where the image begins in it."""
    rows, columns = (n * 2 * -(-(n + 2 * reach) // (2 * n)) for n in image.shape[-2:])
    top, left = (rows - image.shape[-2]) // 2, (columns - image.shape[-1]) // 2
    y = mirrored(torch.arange(-top, rows - top, device=image.device), image.shape[-2])
    x = mirrored(torch.arange(-left, columns - left, device=image.device), image.shape[-1])
    return image[..., y[:, None], x[None, :]], (top, left)


def _transfer(stack: Tensor, rows: int, columns: int) -> tuple[Tensor, Tensor]:
    """Means over the depths of PSFs [depth, channel, y, x]: of their transfer functions, about their first
    pixel, and of the squares of these; both [channel, rows, columns // 2 + 1]. Depth by depth, as a stack of
    transfer functions would not fit into a processor's cache."""
    shape = (stack.shape[1], rows, columns // 2 + 1)
    mean = torch.zeros(shape, dtype=torch.promote_types(stack.dtype, torch.complex64), device=stack.device)
    power = torch.zeros(shape, dtype=stack.dtype, device=stack.device)
    for psf in stack:
        transfer = torch.fft.fft(torch.fft.rfft(psf, columns), rows, dim=-2)
        mean += transfer
        power += transfer.real.square() + transfer.imag.square()
    return mean / len(stack), power / len(stack)


def _noise_to_signal(
    spectrum: Tensor, power: Tensor, noise: float | Tensor, shape: tuple[int, int]
) -> Tensor:
    """N / S, [channel, y, x // 2 + 1], for S = c / f^2.

    c is what the photo itself says where the optics pass it on: the mean of (|Y|^2 - N) f^2 / E|H|^2 over
    the frequencies with E|H|^2 above a tenth of its largest value, which end where the choice matters.
    """
    rows, columns = shape
    fy = torch.fft.fftfreq(rows, dtype=power.dtype, device=power.device)[:, None]
    fx = torch.fft.rfftfreq(columns, dtype=power.dtype, device=power.device)[None, :]
    squared = fy.square() + fx.square()
    floor = max(noise**2, torch.finfo(power.dtype).eps) * rows * columns
    passed = power > 0.1 * power.amax((-2, -1), keepdim=True)
    signal = (spectrum.abs().square() - floor) * squared / power.clamp_min(torch.finfo(power.dtype).tiny)
    c = torch.where(passed, signal, 0).sum((-2, -1), keepdim=True) / passed.sum((-2, -1), keepdim=True)
    # an image without contrast has no signal to fit: any positive floor leaves its level untouched
    return floor * squared / c.clamp_min(1e-3 * floor * squared.mean())
