"""From the pupil to the sensor: a matrix Fourier transform straight onto the pixels, in real arithmetic.

The field is F = E Q E^T with E = exp(2 pi j kappa x s) (Soummer et al., Opt. Express 15, 15935, 2007). Pupil
and sensor grids are symmetric about the axis and the defocus is even, so everything splits into even and odd
halves: a real product of half the size for each parity takes the place of a complex product of the whole, a
quarter of the multiplications, and the bases are real and the same for all depths. |F|^2 is then summed over
each pixel.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from .grid import PupilGrid


@dataclass(frozen=True)
class SensorWindow:
    """A square window of `pixels` x `pixels` pixels of `pitch` [m], each split in `oversampling`^2 parts.

    The centre pixel has index pixels // 2. What is computed is the symmetric window of an odd number of pixels
    around it.
    """

    pixels: int
    pitch: float
    oversampling: int

    @property
    def sub_pixels(self) -> int:
        """Samples along one axis of the symmetric window."""
        return (self.pixels + 1 - self.pixels % 2) * self.oversampling


@dataclass(frozen=True)
class Bases:
    """What turns a pupil into pixels, the same for all depths at one wavelength.

    fourier: [2 (cos, sin), sub-pixel, cell] on the non-negative halves of both axes. pixels: [2 (+, -), pixel,
    sub-pixel], which pixel the sub-pixel at +x or -x belongs to.
    """

    fourier: Tensor
    pixels: Tensor

    @property
    def halves(self) -> tuple[int, int]:
        """Lengths of the half axes (sensor, pupil)."""
        return self.fourier.shape[1], self.fourier.shape[2]


def make_bases(
    grid: PupilGrid, window: SensorWindow, reach: float, light: float, dtype: torch.dtype, device: torch.device
) -> Bases:
    """Bases for lambda z_i = `reach` [m^2], such that a pupil of `light` cells gives energies that sum to 1.

    By Parseval's theorem the light of the pupil over that of the sensor plane is (cell x sub-pixel / reach)^2.
    A sample that lies on an axis (odd counts) belongs to both halves and is counted half in each.
    """
    kappa = grid.pitch * (window.pitch / window.oversampling) / reach
    sensor, pupil = _half_axis(window.sub_pixels), _half_axis(grid.samples)
    angle = 2 * math.pi * kappa * torch.outer(sensor, pupil)
    fourier = torch.stack([torch.cos(angle), torch.sin(angle)]) * (kappa**2 / light) ** 0.25
    if grid.samples % 2:
        fourier[0, :, 0] /= 2
    # sub-pixel k of the symmetric window lies in pixel k // oversampling; an even window drops the last one
    index = torch.arange(window.sub_pixels) // window.oversampling
    whole = torch.nn.functional.one_hot(index).double()[:, : window.pixels].T
    half = window.sub_pixels // 2
    pixels = torch.stack([whole[:, half:], whole[:, : window.sub_pixels - half].flip(1)])
    if window.sub_pixels % 2:
        pixels[:, :, 0] /= 2
    return Bases(fourier.to(device=device, dtype=dtype), pixels.to(device=device, dtype=dtype))


def _half_axis(count: int) -> Tensor:
    """Non-negative half of a symmetric axis of `count` unit steps, float64."""
    return torch.arange(count // 2, count, dtype=torch.float64) - (count - 1) / 2


def fold(pupil: Tensor) -> Tensor:
    """Even and odd parts of a complex pupil [s, s] about both axes, real: [2 (x), 2 (re, im), 2 (y), half, half]."""
    half = pupil.shape[-1] // 2
    kept = pupil.shape[-1] - half
    right, left = pupil[:, half:], pupil[:, :kept].flip(1)
    columns = torch.stack([right + left, right - left])
    lower, upper = columns[:, half:], columns[:, :kept].flip(1)
    return torch.view_as_real(torch.stack([lower + upper, lower - upper], 1)).permute(0, 4, 1, 2, 3).contiguous()


def unfold(parts: Tensor, samples: int) -> Tensor:
    """Adjoint of `fold`: gradient of the parts back to the complex pupil [samples, samples]."""
    half = samples // 2
    columns = parts.new_zeros(2, 2, samples, parts.shape[-1])
    columns[:, :, half:] += parts[:, :, 0] + parts[:, :, 1]
    columns[:, :, : samples - half] += (parts[:, :, 0] - parts[:, :, 1]).flip(2)
    pupil = parts.new_zeros(2, samples, samples)
    pupil[:, :, half:] += columns[0] + columns[1]
    pupil[:, :, : samples - half] += (columns[0] - columns[1]).flip(2)
    return torch.complex(pupil[0], pupil[1])


def waves(parts: Tensor, chirps: Tensor, bases: Tensor) -> tuple[Tensor, Tensor]:
    """The field's even and odd components in x, each real [2 (re, im), 2 (y parity), y, depth, x] on half axes.

    parts: from `fold`; chirps: complex [depth, half], the defocus along one axis; bases: `Bases.fourier`.
    """
    real, imaginary = _defocus_maps(chirps)
    rows, half = bases.shape[1:]
    depths = chirps.shape[0]
    components = []
    for part, basis in zip(parts, bases, strict=True):
        re, im = part[0, :, :, None], part[1, :, :, None]
        spread = torch.empty(2, 2, half, depths, half, dtype=real.dtype, device=real.device)
        torch.mul(re, real, out=spread[0]).addcmul_(im, imaginary, value=-1)
        torch.mul(re, imaginary, out=spread[1]).addcmul_(im, real)
        first = torch.matmul(bases, spread.view(2, 2, half, depths * half))
        second = torch.mm(first.view(-1, half), basis.T)
        components.append(second.view(2, 2, rows, depths, rows))
    return components[0], components[1]


def _defocus_maps(chirps: Tensor) -> tuple[Tensor, Tensor]:
    """Real and imaginary part of the defocus of each depth on a quarter of the pupil, [y, depth, x]."""
    both = chirps.T[:, :, None] * chirps[None, :, :]
    return both.real.contiguous(), both.imag.contiguous()


def quadrants(even: Tensor, odd: Tensor) -> list[tuple[Tensor, Tensor]]:
    """Real and imaginary part of the field in the quadrants (y, x) = ++, --, +-, -+, each [y, depth, x].

    F(+-y, +-x) = (ee -+ oo) + j (+-oe +- eo), where the first letter is the parity in y.
    """
    ee, oe, eo, oo = even[:, 0], even[:, 1], odd[:, 0], odd[:, 1]
    fields = []
    for same, cross in ((ee - oo, oe + eo), (ee + oo, oe - eo)):
        fields.append((same[0] - cross[1], same[1] + cross[0]))
        fields.append((same[0] + cross[1], same[1] - cross[0]))
    return fields


def intensity(parts: Tensor, chirps: Tensor, bases: Bases) -> Tensor:
    """|F|^2 summed over each pixel, [depth, pixel, pixel], for one wavelength and a block of depths."""
    fields = quadrants(*waves(parts, chirps, bases.fourier))
    energy = [(real * real).addcmul_(imaginary, imaginary) for real, imaginary in fields]
    plus, minus = bases.pixels
    depths, rows = chirps.shape[0], plus.shape[1]
    down = [
        torch.mm(energy[here].view(-1, rows), plus.T).addmm_(energy[there].view(-1, rows), minus.T)
        for here, there in ((0, 2), (3, 1))
    ]
    summed = torch.mm(plus, down[0].view(rows, -1)).addmm_(minus, down[1].view(rows, -1))
    return summed.view(len(plus), depths, len(plus)).permute(1, 0, 2)


def intensity_gradient(upstream: Tensor, parts: Tensor, chirps: Tensor, bases: Bases) -> Tensor:
    """Gradient of a loss by the folded pupil, shaped as `fold` gives it, from that by `intensity`.

    The adjoint of each step in turn, the field computed again rather than kept: Akpinar et al., Eq.
    `partialEphi3`, with this transform in place of the discrete Fourier transform.
    """
    fields = quadrants(*waves(parts, chirps, bases.fourier))
    plus, minus = bases.pixels
    depths, rows = chirps.shape[0], plus.shape[1]
    turned = upstream.permute(1, 0, 2).reshape(len(plus), -1)
    up, down = (torch.mm(sign.T, turned).view(-1, len(plus)) for sign in (plus, minus))
    weights = (torch.mm(up, plus), torch.mm(down, minus), torch.mm(up, minus), torch.mm(down, plus))
    pulled = [
        (2 * weight.view(rows, depths, rows) * real, 2 * weight.view(rows, depths, rows) * imaginary)
        for weight, (real, imaginary) in zip(weights, fields, strict=True)
    ]
    same, cross = _joined(pulled[0], pulled[1])
    same_, cross_ = _joined(pulled[2], pulled[3])
    even = torch.stack([same + same_, cross + cross_], 1)
    odd = torch.stack([cross - cross_, same_ - same], 1)
    real, imaginary = _defocus_maps(chirps)
    half = bases.halves[1]
    gradients = []
    for component, basis in zip((even, odd), bases.fourier, strict=True):
        first = torch.mm(component.view(-1, rows), basis).view(2, 2, rows, depths * half)
        spread = torch.matmul(bases.fourier.transpose(1, 2), first).view(2, 2, half, depths, half)
        by_real = (spread[0] * real).addcmul_(spread[1], imaginary).sum(2)
        by_imaginary = (spread[1] * real).addcmul_(spread[0], imaginary, value=-1).sum(2)
        gradients.append(torch.stack([by_real, by_imaginary]))
    return torch.stack(gradients)


Pulled = tuple[Tensor, Tensor]


def _joined(here: Pulled, there: Pulled) -> tuple[Tensor, Tensor]:
    """Adjoint of one pair in `quadrants`: gradients by (same, cross), each [2 (re, im), y, depth, x]."""
    same = torch.stack([here[0] + there[0], here[1] + there[1]])
    cross = torch.stack([here[1] - there[1], there[0] - here[0]])
    return same, cross
