"""Point spread functions over depth and wavelength."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor

from ..errors import InputError
from . import cache as bank_cache
from .camera import Camera, defocus
from .height import trained_pitch
from .propagation import propagate
from .pupil import Aperture, aperture, chirp, pupil_function
from .sampling import Sampling, plan_sampling
from .transform import SensorWindow, make_bases

LARGEST_BYTES = 8 << 30
"""Largest bank that is computed; beyond it the work is refused before it is begun."""


@dataclass(frozen=True)
class PsfBank:
    """PSFs in upright-picture orientation, row 0 the top, ready to be convolved with the upright picture.

    values: [depth, band, y, x], energy that lands in each pixel as a fraction of the light that the mask
    lets through, the centre pixel at index n // 2. rest: [depth, band], the fraction that lands outside the
    window, so that values.sum((-1, -2)) + rest = 1. transmission: the light that the mask lets through as a
    fraction of what the open aperture would. wavelengths: [band], metres; inverse_depths: [depth], 1/m;
    both float64.
    """

    values: Tensor
    rest: Tensor
    wavelengths: Tensor
    inverse_depths: Tensor
    transmission: float
    sampling: Sampling


def psf_bank(
    camera: Camera,
    wavelengths: Tensor | Sequence[float],
    inverse_depths: Tensor | Sequence[float],
    *,
    window_px: int | None = None,
    height: Tensor | None = None,
    seed: int | None = None,
    dtype: torch.dtype = torch.float32,
    device: torch.device | str = "cpu",
    cache: Path | None = None,
) -> PsfBank:
    """PSFs of a camera for wavelengths [band] in metres and inverse depths [depth] in 1/m.

    Akpinar et al., Eqs. `PSF`, `Q` and `defocus`, with the exact lens of Eq. `spherical`, on an oversampled
    grid of the sensor that is summed over each pixel. window_px: width of the window in place of the
    recipe's. height: [n, n] in metres in place of the recipe's mask, differentiable. seed: of the
    fabrication error in place of the recipe's. cache: a folder for banks that outlive the process; those
    without a trainable height are kept in memory in any case.

    Beside the bank itself the work takes a fixed memory (`propagation.BLOCK_BYTES`) and a few waves.

    Raises InputError for empty or invalid wavelengths and depths, wavelengths outside the glass data, a pupil
    sampling that cannot be met, and a bank too large to begin.
    """
    wavelengths, inverse_depths = _axes(camera, wavelengths, inverse_depths, relief=height is not None)
    pixels = camera.recipe.psf.window_px if window_px is None else window_px
    if dtype not in (torch.float32, torch.float64):
        raise InputError(f"PSFs are computed in float32 or float64, not {dtype}")
    if height is not None:
        _check_height(height)
    trainable = height is not None and height.requires_grad and torch.is_grad_enabled()
    key = None
    if not trainable:
        key = bank_cache.key(camera, wavelengths, inverse_depths, pixels, height, seed, dtype)
        known = bank_cache.find(key, cache)
        if known is not None:
            return known if str(device) == "cpu" else _moved(known, device)
    shape = (len(inverse_depths), len(wavelengths), pixels, pixels)
    _check_size(shape, dtype)
    pitch = None if height is None else trained_pitch(camera, height.shape[-1])
    sampling = plan_sampling(camera, wavelengths, inverse_depths, pixels, pitch)
    opening = aperture(camera, sampling.grid, height, seed)
    bands = _bands(camera, opening, wavelengths, inverse_depths, pixels, dtype, torch.device(device))
    if trainable:
        values = torch.stack(list(bands), dim=1)
    else:
        values = torch.empty(shape, dtype=dtype, device=device)
        for into, band in zip(values.unbind(1), bands, strict=True):
            into.copy_(band)
    rest = 1 - values.sum((-1, -2))
    bank = PsfBank(values, rest, wavelengths, inverse_depths, opening.transmission, sampling)
    if key is not None:
        bank_cache.keep(key, _moved(bank, "cpu"), cache)
    return bank


def _bands(
    camera: Camera,
    opening: Aperture,
    wavelengths: Tensor,
    inverse_depths: Tensor,
    pixels: int,
    dtype: torch.dtype,
    device: torch.device,
) -> Iterator[Tensor]:
    """The PSFs of each wavelength in turn, [depth, y, x]."""
    window = SensorWindow(pixels, camera.pixel, camera.recipe.psf.oversampling)
    for wavelength in wavelengths.tolist():
        pupil = pupil_function(camera, opening, wavelength, dtype=dtype, device=device)
        psi = defocus(camera, wavelength, inverse_depths)
        chirps = chirp(opening.grid, psi, dtype=dtype, device=device)
        reach = wavelength * camera.sensor_distance
        bases = make_bases(opening.grid, window, reach, opening.light, dtype, device)
        yield propagate(pupil, chirps, bases)[:, :pixels, :pixels]


def _axes(
    camera: Camera,
    wavelengths: Tensor | Sequence[float],
    inverse_depths: Tensor | Sequence[float],
    relief: bool,
) -> tuple[Tensor, Tensor]:
    wavelengths = torch.as_tensor(wavelengths, dtype=torch.float64, device="cpu").flatten().detach()
    inverse_depths = torch.as_tensor(inverse_depths, dtype=torch.float64, device="cpu").flatten().detach()
    problems = []
    if wavelengths.numel() == 0 or inverse_depths.numel() == 0:
        problems.append("PSFs need at least one wavelength and one depth")
    if not bool(torch.isfinite(inverse_depths).all()) or bool((inverse_depths < 0).any()):
        problems.append(
            "inverse depths must be finite and not negative (0 is infinity); nothing lies behind the lens"
        )
    relief = relief or hasattr(camera.recipe.mask, "material")
    for material in (camera.glass, camera.mask_material) if relief else (camera.glass,):
        try:
            material.index(wavelengths)
        except InputError as error:
            problems.extend(error.problems)
    if problems:
        raise InputError(problems)
    return wavelengths, inverse_depths


def _check_size(shape: tuple[int, ...], dtype: torch.dtype) -> None:
    size = math.prod(shape) * dtype.itemsize
    if size > LARGEST_BYTES:
        raise InputError(
            f"a bank of {shape[0]} depths x {shape[1]} bands x {shape[2]} x {shape[3]} pixels would take"
            f" {size / 2**30:.3g} GiB, more than {LARGEST_BYTES / 2**30:.3g}; ask for fewer depths or bands"
            " at a time, or a smaller window"
        )


def _check_height(height: Tensor) -> None:
    if height.ndim != 2 or height.shape[0] != height.shape[1] or not height.is_floating_point():
        raise InputError(
            f"a height map is square, [n, n], and real; got {tuple(height.shape)}, {height.dtype}"
        )


def _moved(bank: PsfBank, device: torch.device | str) -> PsfBank:
    values, rest = bank.values.to(device), bank.rest.to(device)
    return PsfBank(values, rest, bank.wavelengths, bank.inverse_depths, bank.transmission, bank.sampling)
