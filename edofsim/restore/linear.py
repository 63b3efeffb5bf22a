"""How well a linear filter could restore what a mask photographs, in closed form.

The least mean square error of one filter for all depths follows from the PSFs and the statistics of
photographs alone, and its gradient has no noise, while a gradient through single patches and an untrained
network is noise for the most part. Three filters stand for three kinds of restorers:

`wiener_error` for Wiener deconvolution, which sees the whole photo and each colour alone;

`local_error` for a convolutional network or a bank of filters, which see some pixels around each, but all
colours: the edges of photographs are nearly the same in all, so that what one colour has lost can be had from
another that is sharp at that depth. With its PSNR that of a trained D-CNN rises and falls over depth;

`colour_error` for a filter that sees all colours and the whole photo: less than it leaves, no filter can. A
mask that is designed for it wants wider filters than any bank's.
"""

from __future__ import annotations

from functools import reduce

import torch
from scipy.fft import next_fast_len
from torch import Tensor

from .photograph_statistics import colour_spectra, power_spectrum, transfer_functions

NOISE = 0.006  # read noise, below the middle of the training's range
SUPPORT = 9
FINE_NOISE = 0.002  # with less, covariances are not positive definite in single precision


def _length(at_least: int) -> int:
    """Of transforms that are fast."""

    return next_fast_len(at_least, real=True)


def wiener_error(psf: Tensor, noise: float = NOISE) -> Tensor:
    """Mean square error that Wiener deconvolution leaves where every PSF is equally likely, [depth, channel].

    psf: [depth, channel, y, x], light landing in each pixel.

    With the scene's power spectrum S, the noise's N and the transfer functions H of the depths, the filter is
    W = E[H*] S / (E|H|^2 S + N), and leaves |1 - W H|^2 S + |W|^2 N at each frequency and depth.
    """
    size = _length(2 * psf.shape[-1])
    transfer = transfer_functions(psf, size)
    spectrum = power_spectrum(size, psf)
    mean, power = transfer.mean(0), transfer.abs().square().mean(0)
    inverse = mean.conj() * spectrum / (power * spectrum + noise**2)
    left = (1 - inverse * transfer).abs().square() * spectrum + inverse.abs().square() * noise**2
    return (left * _whole_plane(spectrum, size)).sum((-1, -2)) / size**2


def colour_error(psf: Tensor, noise: float = NOISE, groups: int = 1) -> Tensor:
    """Mean square error of the best filters without bounds that see all colours, [depth, 3].

    psf: [depth, 3, y, x], every one equally likely.
    groups: this many filters, each for as many neighbouring depths.

    At each frequency the filter is the matrix W = X R^-1, with R the covariance of the photo's colours there
    and X that of the scene's with them, both in the mean over a group's depths; at a depth it leaves S - 2
    Re(W X*) + W R W*. The mean over the photo is not judged: it passes whole.
    """
    # no filter is cut off: a period as long as the PSFs will do
    size = _length(psf.shape[-1])
    # in double precision: in coarse details the scene is 1e7 times as strong as the noise
    transfer = transfer_functions(psf, size).to(torch.complex128)
    spectrum = power_spectrum(size, psf.double())
    covariance, with_sharp = (
        (each * spectrum).movedim((1, 2), (-2, -1)) for each in colour_spectra(transfer)
    )
    covariance = covariance + noise**2 * torch.eye(3).to(spectrum)

    def grouped(values: Tensor) -> Tensor:
        return values.unflatten(0, (groups, -1)).mean(1)

    # R is Hermitian: its solution for X's rows is the filter, conjugate and turned
    filters = torch.linalg.solve(grouped(covariance), grouped(with_sharp).mH)
    filters = filters.mH.repeat_interleave(len(psf) // groups, 0)
    passed = (filters * with_sharp.conj()).sum(-1).real
    kept = ((filters @ covariance) * filters.conj()).sum(-1).real
    left = (spectrum[..., None] - 2 * passed + kept) * _whole_plane(spectrum, size)[..., None]
    return left.flatten(1, 2)[:, 1:].sum(1) / size**2


def _whole_plane(spectrum: Tensor, size: int) -> Tensor:
    """How often each frequency of the half plane stands in the whole."""
    share = torch.full_like(spectrum, 2.0)
    share[:, 0] = 1
    if size % 2 == 0:
        share[:, -1] = 1
    return share


def local_error(psf: Tensor, noise: float = NOISE, support: int = SUPPORT, groups: int = 1) -> Tensor:
    """Mean square error of the best filter of `support` x `support` pixels of all channels, [depth, channel].

    psf: [depth, 3, y, x]; every PSF is equally likely.
    groups: this many filters, each for as many neighbouring depths; 1 for a filter that is the same for all.

    For stationary scenes the filter F solves E[R] F = E[X], with R the covariance of the pixels that it sees
    and X theirs with the pixel to be restored; at a depth it leaves V - 2 F X + F R F, V the variance of the
    scene.
    """
    size = _length(2 * psf.shape[-1])
    transfer, spectrum = transfer_functions(psf, size), power_spectrum(size, psf)
    covariance, with_sharp = _placed(*colour_spectra(transfer), spectrum, size, support, noise)
    grouped = covariance.unflatten(0, (groups, -1)).mean(1), with_sharp.unflatten(0, (groups, -1)).mean(1)
    filters = _solve(*grouped).repeat_interleave(len(psf) // groups, 0)
    variance = torch.fft.irfft2(spectrum.to(transfer.dtype), s=(size, size))[0, 0]
    passed = (filters * with_sharp).sum(-1)
    return variance - 2 * passed + ((filters @ covariance) * filters).sum(-1)


def local_filters(psf: Tensor, support: int, groups: int, noise: float = NOISE) -> Tensor:
    """The filters of `local_error`, [group, 3 out, 3 in, support, support], for a convolution of torch.

    psf: [depth, 3, y, x], neighbouring depths next to each other, as many in each group.
    """
    psf, given = (psf.double() if noise < FINE_NOISE else psf), psf
    channels = psf.shape[1]
    size = _length(max(2 * psf.shape[-1], psf.shape[-1] + support))
    transfer, spectrum = transfer_functions(psf, size), power_spectrum(size, psf)
    filters = []
    for part in transfer.unflatten(0, (groups, -1)):  # one at a time: a covariance has support^4 numbers
        covariance, with_sharp = _mean_covariance(part, spectrum, size, support, noise)
        filters.append(_solve(covariance[None], with_sharp[None])[0])
    return torch.stack(filters).unflatten(-1, (channels, support, support)).to(given)


def _solve(covariance: Tensor, with_sharp: Tensor) -> Tensor:
    """F [group, channel, n] of R [group, n, n] and X [group, channel, n]."""
    factor = torch.linalg.cholesky(covariance)
    return torch.cholesky_solve(with_sharp.transpose(-1, -2), factor).transpose(-1, -2)


def _mean_covariance(
    transfer: Tensor, spectrum: Tensor, size: int, support: int, noise: float
) -> tuple[Tensor, Tensor]:
    """Means over depths of R [n, n] and X [channel, n], of the n = channel * support^2 pixels that a filter
    sees."""
    pairs, seen = zip(*(colour_spectra(each) for each in transfer.split(1)), strict=True)
    means = [reduce(torch.add, each) / len(transfer) for each in (pairs, seen)]
    covariance, with_sharp = _placed(means[0], means[1], spectrum, size, support, noise)
    return covariance[0], with_sharp[0]


def _placed(
    pairs: Tensor, with_sharp: Tensor, spectrum: Tensor, size: int, support: int, noise: float
) -> tuple[Tensor, Tensor]:
    """Cross-spectra, see `colour_spectra`, to covariances between the pixels of a filter, [depth, n, n], and
    of theirs with the pixel to be restored, [depth, channel, n]."""
    depths, channels = pairs.shape[:2]
    place = torch.arange(1 - support, support, device=pairs.device)
    covariance = pairs.real.new_empty(depths, channels, support**2, channels, support**2)
    for first in range(channels):
        for second in range(first, channels):
            both = pairs[:, first, second] * spectrum
            shifted = torch.fft.irfft2(both, s=(size, size))[:, place % size][:, :, place % size]
            # [depth, y, x, other y, other x] at the difference of both places
            block = shifted.unfold(1, support, 1).unfold(2, support, 1).flip(-1, -2)
            covariance[:, first, :, second] = block.reshape(depths, support**2, -1)
            covariance[:, second, :, first] = covariance[:, first, :, second].mT.clone()
    covariance = covariance.flatten(3).flatten(1, 2)
    covariance.diagonal(dim1=-2, dim2=-1).add_(noise**2)
    around = (place[support - 1 :] - support // 2) % size
    seen = torch.fft.irfft2(with_sharp.conj() * spectrum, s=(size, size))[..., around, :][..., around]
    return covariance, seen.reshape(depths, channels, -1)
