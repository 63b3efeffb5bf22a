"""The generalised pupil function: what the lens, its mask and a point's distance do to a wave.

Akpinar et al., Eq. `Q`: Q = A exp(j Phi) exp(j Psi rho^2). It is kept in two factors, because only the second
depends on depth and that one is separable: the `pupil_function` without defocus, and the `chirp`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from .camera import Camera
from .grid import PupilGrid
from .lens import spherical_phase
from .masks import mask_amplitude


@dataclass(frozen=True)
class Aperture:
    """What the mask lets through, without phase: amplitude [y, x] (float64), total light and its fraction of
    what the open aperture lets through. Light is counted in cells of the grid."""

    grid: PupilGrid
    amplitude: Tensor
    light: float
    transmission: float


def aperture(camera: Camera, grid: PupilGrid) -> Aperture:
    """The amplitude of the camera's aperture and mask on a grid, with grey edges."""
    amplitude, power = mask_amplitude(camera.recipe.mask, grid)
    light = float(power.sum())
    whole = math.pi * (grid.radius / grid.pitch) ** 2
    return Aperture(grid, amplitude, light, light / whole)


def pupil_function(
    camera: Camera,
    opening: Aperture,
    wavelength: float,
    surface: Tensor | None,
    *,
    dtype: torch.dtype = torch.float32,
    device: torch.device | str = "cpu",
) -> Tensor:
    """Pupil function at `wavelength` [m] without defocus, complex [samples, samples].

    surface: height of the mask [samples, samples] in metres or None; gradients reach it. Phases are summed in
    float64 and reduced modulo 2 pi before they become `dtype`; a surface that is being trained keeps its own
    precision, its phase being a few waves only.
    """
    phase = spherical_phase(camera, wavelength, opening.grid.radius_squared())
    if surface is not None:
        delay = 2 * math.pi / wavelength * (float(camera.mask_material.index(wavelength)) - 1)
        if surface.requires_grad:
            trained = surface.to(device=device, dtype=dtype) * delay
            phase = _reduced(phase).to(device=device, dtype=dtype) + trained
        else:
            phase = phase + delay * surface.to(device="cpu", dtype=torch.float64)
    if not phase.requires_grad:
        phase = _reduced(phase.double()).to(device=device, dtype=dtype)
    return torch.polar(opening.amplitude.to(device=device, dtype=dtype), phase)


def chirp(
    grid: PupilGrid, defocus: Tensor, *, dtype: torch.dtype = torch.float32, device: torch.device | str = "cpu"
) -> Tensor:
    """exp(j Psi s^2 / r^2) along half an axis of the pupil, complex [depth, half], for Psi [depth] in float64.

    It is even, so it is given from the centre outwards only; the phase of a whole defocus is its product along
    both axes.
    """
    axis = grid.centres[grid.samples // 2 :] / grid.radius
    phase = _reduced(defocus.double()[:, None] * axis**2)
    phase = phase.to(device=device, dtype=dtype)
    return torch.polar(torch.ones_like(phase), phase)


def _reduced(phase: Tensor) -> Tensor:
    return torch.remainder(phase + math.pi, 2 * math.pi) - math.pi
