"""PSFs of many points at once, each through its own part of the pupil.

The field is F = E G E^T with E = exp(2 pi j x s / lambda z_i) and G the pupil function with defocus and
visibility. Pupil and sensor are symmetric about the axis, so each product splits into one of even parts with
cosines and one of odd parts with sines, of half the size. Written apart from the transforms of `optics`, so
that the two can be held against each other; only what a pixel integrates is the same.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from ..optics import Camera
from ..optics.grid import PupilGrid, bicubic_matrix
from ..optics.pupil import Aperture
from ..optics.transform import SensorWindow, pixel_weights


@dataclass(frozen=True)
class Transform:
    """From pupil cells to sub-pixels at one wavelength, on the non-negative halves of both axes.

    cosine, sine: float32 [sub-pixel, cell].
    pixels: float32 [pixel, sub-pixel], what each pixel of the whole axis integrates.
    window: pixels of a PSF, centred on pixel window // 2.
    """

    cosine: Tensor
    sine: Tensor
    pixels: Tensor
    window: int


def make_transform(camera: Camera, grid: PupilGrid, wavelength: float, window: int) -> Transform:
    """Bases such that the energy of a field is that of its pupil, in cells."""
    sensor = SensorWindow(window, camera.pixel, camera.oversampling(wavelength))
    sub = camera.pixel / sensor.oversampling
    reach = wavelength * camera.sensor_distance
    place, cell = _half(sensor.sub_pixels) * sub, _half(grid.samples) * grid.pitch
    angle = 2 * math.pi / reach * torch.outer(place, cell)
    scale = math.sqrt(grid.pitch * sub / reach)
    cosine, sine = torch.cos(angle) * scale, torch.sin(angle) * scale
    if grid.samples % 2:
        cosine[:, 0] /= 2  # the cell on the axis is in both halves
    return Transform(cosine.float(), sine.float(), pixel_weights(sensor).float(), window)


def clipped_psf(pupil: Tensor, opening: Aperture, psi: Tensor, wave: Tensor, transform: Transform) -> Tensor:
    """PSFs [n, y, x] of points with defocus psi [n] whose light reaches the pupil as `wave` [n, s, s].

    pupil: complex [s, s] without defocus.
    psi: [n], radians.
    wave: [n, s, s], complex amplitude relative to a free path, from `shadow`.
    """
    grid = opening.grid
    phase = torch.remainder(psi[:, None] * (grid.centres / grid.radius) ** 2, 2 * math.pi).float()
    chirp = torch.polar(torch.ones_like(phase), phase)
    field = wave * (pupil * (chirp[:, :, None] * chirp[:, None, :]))
    return _pixels(_propagated(field, transform), transform) / opening.light


def shadow(lets_by: Tensor, nearer: Tensor, width: float, wavelength: float, grid: PupilGrid) -> Tensor:
    """The light of points behind obstacles, in the pupil: complex [n, s, s], 1 where nothing is in the way.

    lets_by: [n, v, u], what rays to a square of `width` [m] around the pupil say.
    nearer: [n], inverse depth of the obstacle minus that of the point, 1/m.

    Light bends at edges: by Fresnel's integral the wave behind an obstacle is its geometric shadow convolved
    with exp(j pi nearer s^2 / lambda), of spectrum exp(-j pi lambda f^2 / nearer). Obstacles go on beyond the
    square as they are at its border. Where the spectrum would carry light around the square it is cut
    (Matsushima and Shimobaba, Opt. Express 17, 19662, 2009).
    """
    pitch = width / lets_by.shape[-1]
    beyond = lets_by.shape[-1] // 2
    lets_by = torch.nn.functional.pad(lets_by[:, None], (beyond,) * 4, mode="replicate")[:, 0]
    count = lets_by.shape[-1]
    f = torch.fft.fftfreq(count, pitch, dtype=torch.float64)
    nearer = nearer.double()[:, None]
    line = torch.polar(torch.ones(len(nearer), count).double(), -math.pi * wavelength * f**2 / nearer)
    line = line * (wavelength * f.abs() / nearer <= count * pitch / 2 - grid.radius)
    line = line.to(torch.complex64)
    # the obstacle's part is what bends, so that a free pupil stays exactly free
    blocked = torch.fft.fft2((1 - lets_by).to(torch.complex64)) * line[:, :, None] * line[:, None, :]
    wave = 1 - torch.fft.ifft2(blocked)
    at = bicubic_matrix(grid.samples, grid.pitch, count, pitch).to(wave)
    return at @ wave @ at.T


def _propagated(field: Tensor, transform: Transform) -> Tensor:
    """|F|^2 [n, y, x] on sub-pixels, rows downwards, for pupils [n, s, s]."""
    parts = torch.view_as_real(field).permute(3, 0, 1, 2)  # [2, n, s, s]
    bases = (transform.cosine, transform.sine)
    down = [basis @ each for basis, each in zip(bases, _folded(parts, 2), strict=True)]
    both = [[each @ basis.T for basis, each in zip(bases, _folded(rows, 3), strict=True)] for rows in down]
    (ee, eo), (oe, oo) = ([torch.complex(*part) for part in row] for row in both)
    same, cross = ee - oo, 1j * (oe + eo)
    same_, cross_ = ee + oo, 1j * (oe - eo)
    quarter = {(1, 1): same + cross, (-1, -1): same - cross, (1, -1): same_ + cross_, (-1, 1): same_ - cross_}
    energy = {
        sides: value.abs().square().flip([axis for axis, side in zip((1, 2), sides, strict=True) if side < 0])
        for sides, value in quarter.items()
    }
    # a sub-pixel on the axis is in both halves
    odd = transform.cosine.shape[0] * 2 - transform.pixels.shape[1]
    top = torch.cat([energy[-1, -1], energy[-1, 1][:, :, odd:]], 2)
    bottom = torch.cat([energy[1, -1], energy[1, 1][:, :, odd:]], 2)
    return torch.cat([top, bottom[:, odd:]], 1)


def _pixels(sub: Tensor, transform: Transform) -> Tensor:
    """Energy of pixels from sub-pixels, and the window cut to its size; float64."""
    energy = transform.pixels @ sub @ transform.pixels.T
    return energy[:, : transform.window, : transform.window].double()


def _folded(parts: Tensor, axis: int) -> tuple[Tensor, Tensor]:
    """Even and odd parts along an axis, on its non-negative half."""
    size = parts.shape[axis]
    kept = size - size // 2
    upper = parts.narrow(axis, size // 2, kept)
    lower = parts.narrow(axis, 0, kept).flip(axis)
    return upper + lower, upper - lower


def _half(count: int) -> Tensor:
    """Non-negative half of a symmetric axis of `count` unit steps, float64."""
    return torch.arange(count // 2, count, dtype=torch.float64) - (count - 1) / 2
