"""PSFs of many points at once, each through its own part of the pupil.

The field is F = E G E^T with E = exp(2 pi j x s / lambda z_i) and G the pupil function with defocus and
visibility. Pupil and sensor are symmetric about the axis, so each product splits into one of even parts with
cosines and one of odd parts with sines, of half the size. Written apart from the transforms of `optics`, so
that the two can be held against each other.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from ..optics import Camera
from ..optics.grid import PupilGrid
from ..optics.pupil import Aperture


@dataclass(frozen=True)
class Transform:
    """From pupil cells to sub-pixels at one wavelength, on the non-negative halves of both axes.

    cosine, sine: float32 [sub-pixel, cell]; window: pixels of a PSF, centred on pixel window // 2.
    """

    cosine: Tensor
    sine: Tensor
    window: int
    oversampling: int


def make_transform(camera: Camera, grid: PupilGrid, wavelength: float, window: int) -> Transform:
    """Bases such that the energy of a field is that of its pupil, in cells."""
    over = camera.recipe.psf.oversampling
    sub = camera.pixel / over
    reach = wavelength * camera.sensor_distance
    place, cell = _half((window // 2 * 2 + 1) * over) * sub, _half(grid.samples) * grid.pitch
    angle = 2 * math.pi / reach * torch.outer(place, cell)
    scale = math.sqrt(grid.pitch * sub / reach)
    cosine, sine = torch.cos(angle) * scale, torch.sin(angle) * scale
    if grid.samples % 2:
        cosine[:, 0] /= 2  # the cell on the axis is in both halves
    return Transform(cosine.float(), sine.float(), window, over)


def clipped_psf(
    pupil: Tensor, opening: Aperture, psi: Tensor, lets_by: Tensor, transform: Transform
) -> Tensor:
    """PSFs [n, y, x] of points with defocus psi [n] whose light passes `lets_by` [n, v, u] of the pupil.

    pupil: complex [s, s] without defocus; lets_by: fractions in [0, 1] over the pupil's square, row 0 its
    top. Each pixel gets its energy as a fraction of the light through the whole pupil, float64.
    """
    grid = opening.grid
    phase = torch.remainder(psi[:, None] * (grid.centres / grid.radius) ** 2, 2 * math.pi).float()
    chirp = torch.polar(torch.ones_like(phase), phase)
    smooth = torch.nn.functional.interpolate(
        lets_by[:, None], size=_across(grid), mode="bilinear", align_corners=False
    )[:, 0]
    # a fraction of energy: the root keeps that of cells that are half in the shade
    amplitude = _framed(smooth, grid.samples).clamp(0, 1).sqrt()
    field = amplitude * (pupil * (chirp[:, :, None] * chirp[:, None, :]))
    return _pixels(_propagated(field, transform), transform) / opening.light


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
    odd = transform.cosine.shape[0] * 2 - _sub_pixels(transform)  # sub-pixels on the axis are in both halves
    top = torch.cat([energy[-1, -1], energy[-1, 1][:, :, odd:]], 2)
    bottom = torch.cat([energy[1, -1], energy[1, 1][:, :, odd:]], 2)
    return torch.cat([top, bottom[:, odd:]], 1)


def _pixels(sub: Tensor, transform: Transform) -> Tensor:
    """Sub-pixels summed into pixels, and the window cut to its size."""
    over, window = transform.oversampling, transform.window
    count = sub.shape[-1] // over
    return sub.double().reshape(-1, count, over, count, over).sum((2, 4))[:, :window, :window]


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


def _sub_pixels(transform: Transform) -> int:
    return (transform.window // 2 * 2 + 1) * transform.oversampling


def _across(grid: PupilGrid) -> int:
    """Cells of the grid that the pupil's diameter covers, to the nearest of the grid's parity."""
    odd = grid.samples % 2
    return int(round((2 * grid.radius / grid.pitch - odd) / 2)) * 2 + odd


def _framed(smooth: Tensor, size: int) -> Tensor:
    """Widen or crop maps over the pupil's square to the whole grid, repeating the border."""
    extra = size - smooth.shape[-1]
    if extra <= 0:
        start = -extra // 2
        return smooth[..., start : start + size, start : start + size]
    half = extra // 2
    return torch.nn.functional.pad(smooth[:, None], (half, extra - half) * 2, mode="replicate")[:, 0]
