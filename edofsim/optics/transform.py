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
from functools import lru_cache

import torch
from torch import Tensor

from .grid import PupilGrid


@dataclass(frozen=True)
class SensorWindow:
    """A square window of `pixels` x `pixels` pixels of `pitch` [m], each split in `oversampling`^2 parts.

    The centre pixel has index pixels // 2. What is computed is the symmetric window of an odd number of
    pixels around it, with one sub-pixel more on each side.
    """

    pixels: int
    pitch: float
    oversampling: int

    @property
    def symmetric_pixels(self) -> int:
        """Pixels along one axis of the symmetric window."""
        return self.pixels + 1 - self.pixels % 2

    @property
    def sub_pixels(self) -> int:
        """Samples along one axis of the symmetric window."""
        return self.symmetric_pixels * self.oversampling + 2


@lru_cache(maxsize=8)
def pixel_weights(window: SensorWindow) -> Tensor:
    """Weights that integrate samples over each pixel of the symmetric window, float64 [pixel, sub-pixel].

    The midpoint rule with its end correction: 1 within a pixel, 1/24 moved from the outermost sample on each
    side to the next one beyond, so that the error falls with the fourth power of the step. Every sample's
    weights sum to 1 over the pixels: no energy is made or lost.
    """
    count, over = window.symmetric_pixels, window.oversampling
    pixel = torch.arange(count)[:, None]
    sample = torch.arange(window.sub_pixels) - 1 - pixel * over  # 0 is the pixel's first
    weights = ((sample >= 0) & (sample < over)).double()
    for end, beyond in ((0, -1), (over - 1, over)):
        weights += ((sample == beyond).double() - (sample == end).double()) / 24
    return weights


@dataclass(frozen=True)
class Bases:
    """What turns a pupil into pixels, the same for all depths at one wavelength.

    fourier: [2 (cos, sin), sub-pixel, cell].
    pixels: [pixel, sub-pixel], from `pixel_weights`. All on the non-negative halves of their axes; the centre
        pixel gets its other half from the other side.
    """

    fourier: Tensor
    pixels: Tensor

    @property
    def halves(self) -> tuple[int, int]:
        """Lengths of the half axes (sensor, pupil)."""
        return self.fourier.shape[1], self.fourier.shape[2]


def make_bases(
    grid: PupilGrid,
    window: SensorWindow,
    reach: float,
    light: float,
    dtype: torch.dtype,
    device: torch.device,
) -> Bases:
    """Bases for lambda z_i = `reach` [m^2]; energies of a pupil that lets `light` cells through sum to 1.

    By Parseval's theorem the light of the pupil over that of the sensor plane is (cell x sub-pixel /
    reach)^2. A sample that lies on an axis (odd counts) belongs to both halves and is counted half in each.
    """
    kappa = grid.pitch * (window.pitch / window.oversampling) / reach
    sensor, pupil = _half_axis(window.sub_pixels), _half_axis(grid.samples)
    angle = 2 * math.pi * kappa * torch.outer(sensor, pupil)
    fourier = torch.stack([torch.cos(angle), torch.sin(angle)]) * (kappa**2 / light) ** 0.25
    if grid.samples % 2:
        fourier[0, :, 0] /= 2
    # no pixel beyond the centre one has a sample on the other side of the axis
    pixels = pixel_weights(window)[window.symmetric_pixels // 2 :, window.sub_pixels // 2 :].clone()
    if window.sub_pixels % 2:
        pixels[0, 0] /= 2
    return Bases(fourier.to(device=device, dtype=dtype), pixels.to(device=device, dtype=dtype))


def _half_axis(count: int) -> Tensor:
    """Non-negative half of a symmetric axis of `count` unit steps, float64."""
    return torch.arange(count // 2, count, dtype=torch.float64) - (count - 1) / 2


def fold(pupil: Tensor) -> Tensor:
    """Even and odd parts of a complex pupil [s, s], or of one for each depth [depth, s, s], about both axes.

    pupil: [s, s] or [depth, s, s], complex; or some of its rows, and their mirror images.

    Real, [2 (parity in x), 2 (re, im), 2 (parity in y), y, depth, x], half of the pupil each way; one depth
    stands for all.
    """
    pupil = pupil if pupil.ndim == 3 else pupil[None]
    rows, half = (side // 2 for side in pupil.shape[-2:])
    right, left = pupil[..., half:], pupil[..., : pupil.shape[-1] - half].flip(2)
    columns = torch.stack([right + left, right - left])
    lower, upper = columns[:, :, rows:], columns[:, :, : pupil.shape[-2] - rows].flip(2)
    parts = torch.view_as_real(torch.stack([lower + upper, lower - upper], 1))
    return parts.permute(0, 5, 1, 3, 2, 4).contiguous()


def unfold(parts: Tensor, samples: int) -> Tensor:
    """Adjoint of `fold`: gradient by the complex pupil, [(depth,) samples, samples].

    parts: [2 (parity in x), 2 (re, im), 2 (parity in y), y, depth, x], see `fold`.
    samples: of the pupil, along a side.
    """
    half, depths = samples // 2, parts.shape[4]
    columns = parts.new_zeros(2, 2, samples, depths, parts.shape[-1])
    columns[:, :, half:] += parts[:, :, 0] + parts[:, :, 1]
    columns[:, :, : samples - half] += (parts[:, :, 0] - parts[:, :, 1]).flip(2)
    pupil = parts.new_zeros(2, samples, depths, samples)
    pupil[..., half:] += columns[0] + columns[1]
    pupil[..., : samples - half] += (columns[0] - columns[1]).flip(3)
    pupil = torch.complex(pupil[0], pupil[1]).movedim(1, 0)
    return pupil if depths > 1 else pupil[0]


def defocus_maps(chirps: Tensor, lit: slice = slice(None)) -> tuple[Tensor, Tensor]:
    """Real and imaginary part of each depth's defocus on a quarter of the pupil, [y, depth, x].

    chirps: complex [depth, half], the factor along one axis from the centre outwards.
    lit: of y.
    """
    both = chirps.T[lit, :, None] * chirps
    return both.real.contiguous(), both.imag.contiguous()


def waves(parts: Tensor, chirps: Tensor, bases: Tensor) -> tuple[Tensor, Tensor]:
    """The field's even and odd components in x on half axes, real, each [2 (re, im), 2 (y), y, depth, x].

    parts: [2 (parity in x), 2 (re, im), 2 (parity in y), y, depth, x], from `fold`.
    chirps: [depth, half], complex, as in `defocus_maps`.
    bases: `Bases.fourier`, [pixel sample, half].
    """
    return across(down(parts, chirps, bases), bases)


def down(parts: Tensor, chirps: Tensor, bases: Tensor, lit: slice = slice(None)) -> tuple[Tensor, Tensor]:
    """The first half of `waves`: transformed along y alone, each [2 (re, im), 2 (y), y, depth, half].

    parts: as in `waves`, [2, 2, 2, y, depth, x].
    chirps: [depth, half], complex.
    bases: `Bases.fourier`, [pixel sample, half].
    lit: along half of the y axis, beyond which there is no light, and may be no parts. The axis that is
        transformed first is the outer one, so that one product serves all depths.
    """
    real, imaginary = defocus_maps(chirps, lit)
    bases = bases[..., lit]
    parts = parts if parts.shape[-3] == bases.shape[-1] else parts[..., lit, :, :]
    rows, high = bases.shape[1:]
    depths, half = chirps.shape
    spread = torch.empty(2, 2, high, depths, half, dtype=real.dtype, device=real.device)
    components = []
    for part in parts:
        re, im = part
        torch.mul(re, real, out=spread[0]).addcmul_(im, imaginary, value=-1)
        torch.mul(re, imaginary, out=spread[1]).addcmul_(im, real)
        first = torch.matmul(bases, spread.view(2, 2, high, depths * half))
        components.append(first.view(2, 2, rows, depths, half))
    return components[0], components[1]


def across(components: tuple[Tensor, Tensor], bases: Tensor) -> tuple[Tensor, Tensor]:
    """The second half of `waves`: along x, from what `down` gives.

    components: from `down`, [2 (re, im), 2 (y), y, depth, half] each.
    bases: `Bases.fourier`, [pixel sample, half].
    """
    rows, half = bases.shape[1:]
    done = [
        torch.mm(first.view(-1, half), basis.T).view(*first.shape[:-1], rows)
        for first, basis in zip(components, bases, strict=True)
    ]
    return done[0], done[1]


def windowed(
    components: tuple[Tensor, Tensor], window: Tensor, lit: slice = slice(None)
) -> tuple[Tensor, Tensor]:
    """What `down` gives of a pupil that is multiplied by a real window [samples] along x, where on half of
    that axis it is `lit`.

    components: from `down`, [2 (re, im), 2 (y), y, depth, half] each.
    window: [samples], real.
    lit: slice of half of the axis.

    The window's odd part turns even components into odd ones, and back.
    """
    half = len(window) // 2
    right, left = window[half:], window[: len(window) - half].flip(0)
    even, odd = (right + left)[lit] / 2, (right - left)[lit] / 2
    one, other = (each[..., lit] for each in components)
    return (one * even).addcmul_(other, odd), (other * even).addcmul_(one, odd)


def waves_gradient(even: Tensor, odd: Tensor, chirps: Tensor, bases: Tensor, each: bool = False) -> Tensor:
    """Adjoint of `waves`: gradient by `parts` from those by the even and odd components.

    even: gradient by the even components, [2 (re, im), 2 (y), y, depth, x].
    odd: gradient by the odd components, [2 (re, im), 2 (y), y, depth, x].
    chirps: [depth, half], complex.
    bases: `Bases.fourier`, [pixel sample, half].
    each: of parts of their own for each depth.
    """
    real, imaginary = defocus_maps(chirps)
    rows, half = bases.shape[1:]
    depths = len(chirps)
    gradients = []
    for component, basis in zip((even, odd), bases, strict=True):
        first = torch.mm(component.view(-1, rows), basis).view(2, 2, rows, depths * half)
        spread = torch.matmul(bases.transpose(1, 2), first).view(2, 2, half, depths, half)
        by_real = (spread[0] * real).addcmul_(spread[1], imaginary)
        by_imaginary = (spread[1] * real).addcmul_(spread[0], imaginary, value=-1)
        found = torch.stack([by_real, by_imaginary])
        gradients.append(found if each else found.sum(3, keepdim=True))
    return torch.stack(gradients)


SIDES = ((1, 1), (-1, -1), (1, -1), (-1, 1))
"""The four quadrants of the sensor as directions from its centre along y and x; two opposite ones make a
pair.
"""


def pairs(even: Tensor, odd: Tensor) -> tuple[tuple[Tensor, Tensor], ...]:
    """(same, cross) for each pair of quadrants, [2 (re, im), y, depth, x]: the field is same +- j cross.

    even, odd: [2 (re, im), 2 (y), y, depth, x], from `waves`.

    F(+-y, +-x) = (ee -+ oo) + j (+-oe +- eo), where the first letter is the parity in y.
    """
    ee, oe, eo, oo = even[:, 0], even[:, 1], odd[:, 0], odd[:, 1]
    return (ee - oo, oe + eo), (ee + oo, oe - eo)


def intensity(even: Tensor, odd: Tensor, bases: Bases) -> Tensor:
    """|F|^2 summed over each pixel of the symmetric window, [depth, pixel, pixel], from the `waves`.

    even, odd: [2 (re, im), 2 (y), y, depth, x], from `waves`.
    bases: what sums over pixels, [pixel, sample].
    """
    found = _room_for_densities(even)
    for (total, mixed), (same, cross) in zip(found, pairs(even, odd), strict=True):
        # |same +- j cross|^2 = |same|^2 + |cross|^2 +- 2 Im(same cross*)
        torch.mul(same[0], same[0], out=total).addcmul_(same[1], same[1])
        total.addcmul_(cross[0], cross[0]).addcmul_(cross[1], cross[1])
        torch.mul(same[1], cross[0], out=mixed).addcmul_(same[0], cross[1], value=-1)
    return _summed(found, bases, 2)


def is_even(parts: Tensor) -> bool:
    """Whether a pupil is its own mirror image about both axes.

    parts: [2, 2, 2, y, depth, x], from `fold`.
    """
    return not (bool(parts[1].any()) or bool(parts[0, :, 1].any()))


def even_energy(parts: Tensor, chirps: Tensor, bases: Bases) -> Tensor:
    """`intensity` of the `waves` of a pupil that `is_even`, by a quarter of the work.

    parts: [2, 2, 2, y, depth, x], from `fold`.
    chirps: [depth, half], complex.
    bases: of the transform.
    """
    real, imaginary = defocus_maps(chirps)
    (re, im), cosines = parts[0, :, 0], bases.fourier[0]
    (rows, high), (depths, half) = cosines.shape, chirps.shape
    spread = torch.empty(2, high, depths, half, dtype=real.dtype, device=real.device)
    torch.mul(re, real, out=spread[0]).addcmul_(im, imaginary, value=-1)
    torch.mul(re, imaginary, out=spread[1]).addcmul_(im, real)
    first = torch.matmul(cosines, spread.view(2, high, depths * half))
    field = torch.mm(first.view(-1, half), cosines.T).view(2, rows, depths * rows)
    density = (field[0] * field[0]).addcmul_(field[1], field[1])
    count = len(bases.pixels)
    low = torch.mm(bases.pixels, density).view(-1, rows)
    summed = torch.mm(low, bases.pixels.T).view(count, depths, count)
    image = summed.new_zeros(2 * count - 1, depths, 2 * count - 1)
    for side in SIDES:
        _side(image, side).add_(_turned(summed, side))
    return image.permute(1, 0, 2)


def shared_intensity(
    whole: tuple[tuple[Tensor, Tensor], ...], part: tuple[Tensor, Tensor], bases: Bases
) -> Tensor:
    """Re(F* G) summed over each pixel, as `intensity`.

    whole: `pairs` of F, [2 (re, im), y, depth, x] each.
    part: even and odd components of G, [2 (re, im), 2 (y), y, depth, x] each.
    bases: what sums over pixels, [pixel, sample].
    """
    found = _room_for_densities(part[0])
    for (total, mixed), (same, cross), (own, its_cross) in zip(found, whole, pairs(*part), strict=True):
        # Re((same +- j cross)* (own +- j its_cross))
        torch.mul(same[0], own[0], out=total).addcmul_(same[1], own[1])
        total.addcmul_(cross[0], its_cross[0]).addcmul_(cross[1], its_cross[1])
        torch.mul(cross[0], own[1], out=mixed).addcmul_(cross[1], own[0], value=-1)
        mixed.addcmul_(same[0], its_cross[1], value=-1).addcmul_(same[1], its_cross[0])
    return _summed(found, bases, 1)


def _room_for_densities(components: Tensor) -> Tensor:
    """For what `_summed` sums, [2 (pair of quadrants), 2 (total, mixed), y, depth, x]."""
    return components.new_empty(2, 2, *components.shape[2:])


def _summed(densities: Tensor, bases: Bases, times: int) -> Tensor:
    """Densities summed over each pixel, [depth, pixel, pixel]: total +- times * mixed in two opposite
    quadrants, for each pair of them."""
    rows, depths = densities.shape[2:4]
    count = len(bases.pixels)
    low = torch.matmul(bases.pixels, densities.view(4, rows, -1))
    summed = torch.mm(low.view(-1, rows), bases.pixels.T).view(2, 2, count, depths, count)
    image = summed.new_zeros(2 * count - 1, depths, 2 * count - 1)
    for (total, mixed), sides in zip(summed, (SIDES[:2], SIDES[2:]), strict=True):
        for sign, side in zip((times, -times), sides, strict=True):
            _side(image, side).add_(_turned(torch.add(total, mixed, alpha=sign), side))
    return image.permute(1, 0, 2)


def intensity_gradient(upstream: Tensor, even: Tensor, odd: Tensor, bases: Bases) -> tuple[Tensor, Tensor]:
    """Adjoint of `intensity`: gradients by the even and odd components from that by the pixels.

    upstream: [depth, pixel, pixel].
    even, odd: [2 (re, im), 2 (y), y, depth, x].
    bases: of the transform.
    """
    rows, depths = even.shape[2:4]
    image = upstream.permute(1, 0, 2)
    pulled = []
    for (same, cross), sides in zip(pairs(even, odd), (SIDES[:2], SIDES[2:]), strict=True):
        plus, minus = (_pixel_weights(image, side, bases).view(rows, depths, rows) for side in sides)
        total, mixed = plus + minus, plus - minus
        by_same = torch.stack([total * same[0] - mixed * cross[1], total * same[1] + mixed * cross[0]])
        by_cross = torch.stack([total * cross[0] + mixed * same[1], total * cross[1] - mixed * same[0]])
        pulled.append((by_same, by_cross))
    (same, cross), (same_, cross_) = pulled
    return torch.stack([same + same_, cross + cross_], 1), torch.stack([cross - cross_, same_ - same], 1)


def _pixel_weights(image: Tensor, side: tuple[int, int], bases: Bases) -> Tensor:
    """Twice the value of the pixel that each sub-pixel of a quadrant belongs to, [y, depth * x]."""
    part = _turned(_side(image, side), side)
    down = torch.mm(part.reshape(-1, part.shape[2]), bases.pixels)
    return torch.mm(2 * bases.pixels.T, down.view(len(part), -1))


def _side(image: Tensor, side: tuple[int, int]) -> Tensor:
    """View of one quadrant of an image [y, depth, x] of odd size, its centre row and column included."""
    centre = image.shape[0] // 2
    rows, columns = (slice(centre, None) if sign > 0 else slice(None, centre + 1) for sign in side)
    return image[rows, :, columns]


def _turned(part: Tensor, side: tuple[int, int]) -> Tensor:
    """A quadrant [y, depth, x] counted outwards from the centre, turned to rising order, or back."""
    return part.flip([axis for axis, sign in zip((0, 2), side, strict=True) if sign < 0])
