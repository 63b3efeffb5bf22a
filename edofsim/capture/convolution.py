"""Convolution of light with PSFs: one grid on which nothing wraps into the frame, channels summed as spectra.

Every method goes through `add_convolved`, so that what a photo costs can be counted.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache

import torch
from torch import Tensor


@dataclass(frozen=True)
class Grid:
    """The padded frame and the sizes of its Fourier transforms.

    rows, columns: of the frame with its margin.
    margin: pixels on each side.
    window: width of the PSFs in pixels, centred on pixel window // 2. The transform is as large as it must be
        for light that leaves one side not to come back on the other side inside the frame: where the margin
        holds half a window, it is no larger than the padded frame.
    """

    rows: int
    columns: int
    margin: int
    window: int

    @property
    def pixels(self) -> int:
        return self.rows * self.columns

    @property
    def transform(self) -> tuple[int, int]:
        """(rows, columns) of the transforms: products of small primes."""
        reach = max(self.window - 1 - self.window // 2, self.window // 2) - self.margin
        rows, columns = (max(side, side + reach, self.window) for side in (self.rows, self.columns))
        return fast_length(rows), fast_length(columns, even=True)


def spectrum(image: Tensor, grid: Grid) -> Tensor:
    """Spectrum of images or of PSFs, put at the top left corner: [..., y, x] to [..., ky, kx], half of it.

    image: [..., y, x].
    grid: of the transform.
    """
    return torch.fft.rfft2(image, s=grid.transform)


def add_convolved(total: Tensor | None, light: Tensor, psf: Tensor, weights: Tensor, grid: Grid) -> Tensor:
    """Convolve images with PSFs and add them, weighted, to the channels' spectra.

    total: complex [channel, ky, kx] or None for a first sum.
    light: [n, y, x] of the padded frame, or one for all.
    psf: [n, v, u], or the spectra of either, n convolutions in all.
    weights: [channel, n].
    grid: of the transform.

    Returns the new total; channel c gains sum_n weights[c, n] light[n] * psf[n].
    """
    through, image = (each if each.is_complex() else spectrum(each, grid) for each in (psf, light))
    gained = mixed(weights, image * through)
    return gained if total is None else total + gained


def mixed(weights: Tensor, spectra: Tensor) -> Tensor:
    """Real weights [channel, n] of spectra [..., n, ky, kx]: their sums, [..., channel, ky, kx].

    weights: [channel, n], real.
    spectra: [..., n, ky, kx], complex.
    """
    *several, n, rows, columns = spectra.shape
    own = weights.diagonal()
    if len(weights) == n and int(weights.count_nonzero()) == int(own.count_nonzero()):
        return spectra * own[:, None, None]
    # a real matrix on interleaved real and imaginary parts: half the work of a complex one
    parts = torch.view_as_real(spectra).reshape(*several, n, -1)
    return torch.view_as_complex((weights @ parts).reshape(*several, -1, rows, columns, 2))


def summed_products(pairs: Iterable[tuple[Tensor, Tensor]]) -> Tensor:
    """The sum of the products of pairs of spectra.

    pairs: two arrays of one shape [..., ky, kx] each.
    """
    total = None
    for one, other in pairs:
        total = one * other if total is None else torch.addcmul(total, one, other)
    if total is None:
        raise ValueError("a sum of no products")
    return total


def image_of(total: Tensor, grid: Grid) -> Tensor:
    """Channels' spectra to images of the padded frame: [channel, ky, kx] to [channel, y, x].

    total: [channel, ky, kx], complex.
    grid: of the transform.

    The PSFs' centre pixel moves to the origin here, once for all.
    """
    return centred(torch.fft.irfft2(total, s=grid.transform), grid)


def centred(image: Tensor, grid: Grid) -> Tensor:
    """An image as its transform is, moved by half a window, as one of the padded frame: [..., y, x] both.

    image: [..., y, x].
    grid: of the transform.
    """
    centre = grid.window // 2
    image = torch.roll(image, (-centre, -centre), dims=(-2, -1)) if centre else image
    return image[..., : grid.rows, : grid.columns]


@lru_cache(maxsize=256)
def fast_length(at_least: int, even: bool = False) -> int:
    """The smallest product of 2, 3, 5 and 7 (with a factor 2 if `even`) that is not below `at_least`.

    scipy's `next_fast_len` has other sizes, whose rounding moves single pixels of photos with holes behind
    edges: the sizes stay, so that photos keep their bytes from version to version.
    """
    length = max(1, at_least)
    while True:
        rest = length
        for prime in (2, 3, 5, 7):
            while rest % prime == 0:
                rest //= prime
        if rest == 1 and not (even and length % 2):
            return length
        length += 1
