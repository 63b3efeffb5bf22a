"""Measures of a PSF: transfer functions, Strehl ratio, encircled energy."""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
from torch import Tensor

from .camera import Camera, defocus
from .grid import PupilGrid, disc_coverage
from .pupil import Aperture, aperture, chirp, pupil_function
from .sampling import plan_sampling

FEWEST_SAMPLES = 512
"""Fewest samples across the pupil: what its edge scatters beyond the replica period is missing from a
transfer function, with so many less than 1e-3 of the light."""


def cutoff_frequency(camera: Camera, wavelength: float) -> float:
    """Frequency [1/m on the sensor] beyond which incoherent light carries nothing: 2 r / (lambda z_i)."""
    return 2 * camera.aperture_radius / (wavelength * camera.sensor_distance)


def otf(
    camera: Camera,
    wavelength: float,
    inverse_depths: Tensor | Sequence[float],
    frequencies: Tensor | Sequence[float],
    *,
    angle_deg: float = 0.0,
    with_pixel: bool = False,
    seed: int | None = None,
) -> Tensor:
    """Optical transfer function along one direction, complex128 [depth, frequency], 1 at frequency 0.

    frequencies: [frequency] in 1/m on the sensor; angle_deg: of the frequency vector in the upright picture,
    counter-clockwise from the right. The Fourier transform of the whole PSF (Goodman, Introduction to Fourier
    Optics, section 6.3: the autocorrelation of the pupil function), sampled at the rate of the pupil's own
    bandwidth, so that it is free of the sensor's aliasing. with_pixel: times the transform of a square pixel.
    seed: as in `psf_bank`. Raises InputError as `psf_bank` does.
    """
    inverse_depths = torch.as_tensor(inverse_depths, dtype=torch.float64).flatten()
    frequencies = torch.as_tensor(frequencies, dtype=torch.float64).flatten()
    across = frequencies * math.cos(math.radians(angle_deg))
    up = frequencies * math.sin(math.radians(angle_deg))
    images, step, _ = _intensities(camera, wavelength, inverse_depths, seed)
    count = images.shape[-1]
    position = (torch.arange(count, dtype=torch.float64) - count // 2) * step
    along_x = _wave(-across[None, :] * position[:, None])
    along_y = _wave(up[None, :] * position[:, None])
    transform = torch.stack([((image.to(along_x.dtype) @ along_x) * along_y).sum(0) for image in images])
    transform = transform / images.sum((-1, -2))[:, None]
    # exactly 0 beyond the cut-off, where the samples would repeat the spectrum
    transform = transform * (frequencies.abs() < cutoff_frequency(camera, wavelength))
    if with_pixel:
        transform = transform * torch.sinc(across * camera.pixel) * torch.sinc(up * camera.pixel)
    return transform


def mtf(
    camera: Camera,
    wavelength: float,
    inverse_depths: Tensor | Sequence[float],
    frequencies: Tensor | Sequence[float],
    **options,
) -> Tensor:
    """Modulation transfer function |`otf`|, float64 [depth, frequency]; options as for `otf`."""
    return otf(camera, wavelength, inverse_depths, frequencies, **options).abs()


def through_focus_mtf(
    camera: Camera, wavelength: float, inverse_depths: Tensor | Sequence[float], frequency: float, **options
) -> Tensor:
    """MTF of one frequency [1/m] at each depth, float64 [depth]; options as for `otf`."""
    return mtf(camera, wavelength, inverse_depths, [frequency], **options)[:, 0]


def strehl(
    camera: Camera,
    wavelengths: Tensor | Sequence[float],
    inverse_depths: Tensor | Sequence[float],
    *,
    on_axis: bool = False,
    seed: int | None = None,
) -> Tensor:
    """Peak of each PSF over that of the same amplitude without aberration, float64 [depth, band].

    on_axis: the intensity in the middle instead of the peak, wherever that lies.
    """
    inverse_depths = torch.as_tensor(inverse_depths, dtype=torch.float64).flatten()
    ratios = []
    for wavelength in torch.as_tensor(wavelengths, dtype=torch.float64).flatten().tolist():
        padding = 2 if on_axis else 4  # between samples of the coarser grid a peak could be missed
        images, _, opening = _intensities(camera, wavelength, inverse_depths, seed, padding)
        middle = images.shape[-1] // 2
        peaks = images[:, middle, middle] if on_axis else images.amax((-1, -2))
        ratios.append(peaks / float(sum(part for part, _ in opening.regions).sum()) ** 2)
    return torch.stack(ratios, dim=1)


def encircled_energy(psfs: Tensor, radii_px: Tensor | Sequence[float]) -> Tensor:
    """Energy of each PSF within circles around its centre pixel's middle, [..., radius].

    psfs: [..., y, x] as `PsfBank.values`, so that what lies outside the window counts as light too; radii in
    pixels. Pixels that a circle crosses count with the part that is inside.
    """
    size = psfs.shape[-1]
    grid = PupilGrid(size + 1 - size % 2, 1.0, 1.0)
    inside = torch.stack([disc_coverage(grid, float(radius))[:size, :size] for radius in radii_px])
    return torch.einsum("...yx,ryx->...r", psfs, inside.to(psfs))


def _intensities(
    camera: Camera,
    wavelength: float,
    inverse_depths: Tensor,
    seed: int | None,
    padding: int = 2,
) -> tuple[Tensor, float, Aperture]:
    """|F|^2 [depth, y, x] over a whole replica period in upright orientation, its step [m], and the pupil."""
    wavelengths = torch.tensor([wavelength], dtype=torch.float64)
    grid = plan_sampling(camera, wavelengths, inverse_depths, camera.recipe.psf.window_px).grid
    if grid.samples < FEWEST_SAMPLES:
        pitch = 2 * camera.aperture_radius / (FEWEST_SAMPLES - 2)
        grid = PupilGrid(FEWEST_SAMPLES, pitch, camera.aperture_radius)
    opening = aperture(camera, grid, seed)
    pupil = pupil_function(camera, opening, wavelength, dtype=torch.float64)
    half = chirp(grid, defocus(camera, wavelength, inverse_depths), dtype=torch.float64)
    whole = torch.cat([half.flip(1)[:, : grid.samples // 2], half], dim=1)
    count = padding * grid.samples
    images = []
    for of_depth in whole:
        field = torch.fft.ifft2(
            pupil * of_depth[:, None] * of_depth[None, :], s=(count, count), norm="forward"
        )
        images.append(torch.fft.fftshift(field.abs() ** 2))
    return torch.stack(images), wavelength * camera.sensor_distance / (count * grid.pitch), opening


def _wave(cycles: Tensor) -> Tensor:
    return torch.polar(torch.ones_like(cycles), 2 * math.pi * cycles)
