"""From the pupil to the sensor: a matrix Fourier transform straight onto the pixels, in real arithmetic.

The field is F = E Q E^T with E = exp(2 pi j kappa x s) (Soummer et al., Opt. Express 15, 15935, 2007). Pupil and
sensor grids are symmetric about the axis and the defocus is even, so everything splits into even and odd halves:
a real product of half the size for each parity takes the place of a complex product of the whole, a quarter of
the multiplications, and the bases are real and the same for all depths. |F|^2 is then summed over each pixel.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from .grid import PupilGrid


@dataclass(frozen=True)
class SensorWindow:
    """A square window of `pixels` x `pixels` pixels of `pitch` [m], each split in `oversampling`^2 sub-pixels.

    The centre pixel has index pixels // 2. Computed is the symmetric window of an odd number of pixels around
    it; for an even window the last row and column are then left out.
    """

    pixels: int
    pitch: float
    oversampling: int

    @property
    def symmetric_pixels(self) -> int:
        return self.pixels + 1 - self.pixels % 2

    @property
    def sub_pixels(self) -> int:
        return self.symmetric_pixels * self.oversampling


def half_axis(count: int) -> Tensor:
    """Distances from the centre of a symmetric axis of `count` unit steps, its non-negative half, float64."""
    return torch.arange(count // 2, count, dtype=torch.float64) - (count - 1) / 2


def half_bases(grid: PupilGrid, window: SensorWindow, reach: float) -> Tensor:
    """Cosine and sine of 2 pi kappa x s on the halves of both axes, float64 [2, y, s].

    reach: lambda z_i [m^2]. A sample on the axis (odd counts) belongs to both halves and is counted half in
    the cosine.
    """
    kappa = grid.pitch * (window.pitch / window.oversampling) / reach
    pupil = half_axis(grid.samples)
    angle = 2 * math.pi * kappa * torch.outer(half_axis(window.sub_pixels), pupil)
    bases = torch.stack([torch.cos(angle), torch.sin(angle)])
    if grid.samples % 2:
        bases[0, :, 0] /= 2
    return bases


def fold(pupil: Tensor) -> Tensor:
    """Even and odd parts of a pupil [s, s] about both axes: [2 (y), 2 (x), half, half]."""
    half = pupil.shape[-1] // 2
    lower, upper = pupil[half:], pupil[: pupil.shape[-1] - half].flip(0)
    rows = torch.stack([lower + upper, lower - upper])
    right, left = rows[..., half:], rows[..., : pupil.shape[-1] - half].flip(-1)
    return torch.stack([right + left, right - left], dim=1)


def unfold(parts: Tensor, samples: int) -> Tensor:
    """Adjoint of `fold`: gradients of the parts back to the pupil [samples, samples]."""
    half = samples // 2
    full = parts.new_zeros(2, parts.shape[2], samples)
    full[..., half:] += parts[:, 0] + parts[:, 1]
    full[..., : samples - half] += (parts[:, 0] - parts[:, 1]).flip(-1)
    pupil = parts.new_zeros(samples, samples)
    pupil[half:] += full[0] + full[1]
    pupil[: samples - half] += (full[0] - full[1]).flip(0)
    return pupil


def defocused(parts: Tensor, chirps: Tensor) -> Tensor:
    """Folded pupil times the defocus of each depth, real and imaginary parts apart.

    parts: complex [2, 2, a, b] from `fold`; chirps: complex [depth, half]. Returns [2 (re, im), 2 (y), a, depth,
    2 (x), b]: the axis to be transformed first is outside, so that one product serves all depths.
    """
    both = (chirps[:, :, None] * chirps[:, None, :]).permute(1, 0, 2)
    real, imaginary = both.real.contiguous()[:, :, None], both.imag.contiguous()[:, :, None]
    q_real = parts.real.permute(0, 2, 1, 3).contiguous()[:, :, None]
    q_imaginary = parts.imag.permute(0, 2, 1, 3).contiguous()[:, :, None]
    shape = (2, 2, parts.shape[2], chirps.shape[0], 2, parts.shape[3])
    out = torch.empty(shape, dtype=real.dtype, device=real.device)
    torch.mul(q_real, real, out=out[0])
    out[0].addcmul_(q_imaginary, imaginary, value=-1)
    torch.mul(q_real, imaginary, out=out[1])
    out[1].addcmul_(q_imaginary, real)
    return out


def waves(parts: Tensor, chirps: Tensor, bases: Tensor) -> tuple[Tensor, ...]:
    """The four parity components of the field, each [2 (re, im), y, depth, x] on half axes: ee, eo, oe, oo.

    F(+-y, +-x) = (ee -+ oo) + j (+-oe +- eo): the first letter is the parity in y.
    """
    spread = defocused(parts, chirps)
    rows, half = bases.shape[1:]
    first = torch.matmul(bases, spread.reshape(2, 2, half, -1)).view(2, 2, rows, chirps.shape[0], 2, half)
    return tuple(first[:, y, :, :, x] @ bases[x].T for y in (0, 1) for x in (0, 1))


def pixel_sums(image: Tensor, window: SensorWindow) -> Tensor:
    """Sum sub-pixels [depth, y, x] into pixels and crop the symmetric window to [depth, pixels, pixels]."""
    count, over = window.symmetric_pixels, window.oversampling
    summed = image.reshape(-1, count, over, count, over).sum((2, 4)) if over > 1 else image
    return summed[:, : window.pixels, : window.pixels]


def quadrants(image: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Views of [depth, y, x] on half axes counted from the centre, as [y, depth, x]: (++), (--), (+-), (-+).

    The axis itself (odd counts) is in all of them.
    """
    turned = image.permute(1, 0, 2)
    half = turned.shape[0] // 2
    plus, minus = slice(half, None), slice(None, turned.shape[0] - half)
    return turned[plus, :, plus], turned[minus, :, minus], turned[plus, :, minus], turned[minus, :, plus]


def intensity(parts: Tensor, chirps: Tensor, bases: Tensor, window: SensorWindow) -> Tensor:
    """|F|^2 summed over each pixel, [depth, pixels, pixels], for one wavelength and a block of depths."""
    ee, eo, oe, oo = waves(parts, chirps, bases)
    same, cross = ee - oo, oe + eo
    total = same.square().sum(0) + cross.square().sum(0)
    mixed = 2 * (same[1] * cross[0] - same[0] * cross[1])
    sub = window.sub_pixels
    image = torch.empty(chirps.shape[0], sub, sub, dtype=total.dtype, device=total.device)
    plus_plus, minus_minus, plus_minus, minus_plus = quadrants(image)
    plus_plus.copy_(total + mixed)
    minus_minus.copy_((total - mixed).flip(0, 2))
    same, cross = ee + oo, oe - eo
    total = same.square().sum(0) + cross.square().sum(0)
    mixed = 2 * (same[1] * cross[0] - same[0] * cross[1])
    plus_minus.copy_((total + mixed).flip(2))
    minus_plus.copy_((total - mixed).flip(0))
    return pixel_sums(image, window)


def intensity_gradient(
    upstream: Tensor, parts: Tensor, chirps: Tensor, bases: Tensor, window: SensorWindow
) -> Tensor:
    """Gradient of a loss by the folded pupil [2, 2, a, b] (PyTorch's convention), given that by `intensity`.

    The adjoint of each step in turn, the field computed again rather than kept: Akpinar et al., Eq.
    `partialEphi3`, with this transform in place of the discrete Fourier transform.
    """
    ee, eo, oe, oo = waves(parts, chirps, bases)
    image = _spread(upstream, window)
    plus_plus, minus_minus, plus_minus, minus_plus = quadrants(image)
    minus_minus, plus_minus, minus_plus = minus_minus.flip(0, 2), plus_minus.flip(2), minus_plus.flip(0)
    same, cross = _pair_gradient(ee - oo, oe + eo, plus_plus, minus_minus)
    same_, cross_ = _pair_gradient(ee + oo, oe - eo, plus_minus, minus_plus)
    components = (same + same_, cross - cross_, cross + cross_, same_ - same)
    rows, half = bases.shape[1:]
    depth = chirps.shape[0]
    first = torch.empty(2, 2, rows, depth, 2, half, dtype=bases.dtype, device=bases.device)
    for (y, x), component in zip(((0, 0), (0, 1), (1, 0), (1, 1)), components, strict=True):
        first[:, y, :, :, x] = component @ bases[x]
    back = torch.matmul(bases.transpose(1, 2), first.view(2, 2, rows, -1)).view(2, 2, half, depth, 2, half)
    both = (chirps[:, :, None] * chirps[:, None, :]).permute(1, 0, 2)
    real, imaginary = both.real[:, :, None], both.imag[:, :, None]
    summed_real = (back[0] * real).addcmul_(back[1], imaginary).sum(2)
    summed_imaginary = (back[1] * real).addcmul_(back[0], imaginary, value=-1).sum(2)
    return torch.complex(summed_real, summed_imaginary).permute(0, 2, 1, 3)


def _spread(upstream: Tensor, window: SensorWindow) -> Tensor:
    """Adjoint of `pixel_sums`: every sub-pixel gets its pixel's value.

    On an odd grid the axes lie in two quadrants each, of which each gets half.
    """
    missing = window.symmetric_pixels - window.pixels
    over = window.oversampling
    full = torch.nn.functional.pad(upstream, (0, missing, 0, missing))
    full = full.repeat_interleave(over, 1).repeat_interleave(over, 2)
    if window.sub_pixels % 2:
        centre = window.sub_pixels // 2
        full = full.contiguous().clone()
        full[:, centre] /= 2
        full[:, :, centre] /= 2
    return full


def _pair_gradient(same: Tensor, cross: Tensor, plus: Tensor, minus: Tensor) -> tuple[Tensor, Tensor]:
    """Gradients by (same, cross) of plus . |same + j cross|^2 + minus . |same - j cross|^2, [2, y, depth, x]."""
    total, mixed = 2 * (plus + minus), 2 * (plus - minus)
    by_same = torch.stack([total * same[0] - mixed * cross[1], total * same[1] + mixed * cross[0]])
    by_cross = torch.stack([total * cross[0] + mixed * same[1], total * cross[1] - mixed * same[0]])
    return by_same, by_cross
