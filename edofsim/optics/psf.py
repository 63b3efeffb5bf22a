"""Point spread functions over depth and wavelength."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor

from ..errors import InputError
from . import cache as bank_cache
from .camera import Camera, defocus
from .height import trained_pitch
from .propagation import propagate
from .pupil import aperture, chirp, pupil_function
from .sampling import Sampling, plan_sampling
from .transform import SensorWindow, make_bases


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

    Raises InputError for empty or invalid wavelengths and depths, wavelengths outside the glass data, and a
    pupil sampling that cannot be met.
    """
    wavelengths, inverse_depths = _axes(camera, wavelengths, inverse_depths)
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
    window = SensorWindow(pixels, camera.pixel, camera.recipe.psf.oversampling)
    pitch = None if height is None else trained_pitch(camera, height.shape[-1])
    sampling = plan_sampling(camera, wavelengths, inverse_depths, pixels, pitch)
    opening = aperture(camera, sampling.grid, height, seed)
    psi = defocus(camera, wavelengths[None, :], inverse_depths[:, None])
    bands = []
    for band, wavelength in enumerate(wavelengths.tolist()):
        pupil = pupil_function(camera, opening, wavelength, dtype=dtype, device=device)
        chirps = chirp(sampling.grid, psi[:, band], dtype=dtype, device=device)
        reach = wavelength * camera.sensor_distance
        bases = make_bases(sampling.grid, window, reach, opening.light, dtype, pupil.device)
        bands.append(propagate(pupil, chirps, bases)[:, :pixels, :pixels])
    values = torch.stack(bands, dim=1)
    rest = 1 - values.sum((-1, -2))
    bank = PsfBank(values, rest, wavelengths, inverse_depths, opening.transmission, sampling)
    if key is not None:
        bank_cache.keep(key, _moved(bank, "cpu"), cache)
    return bank


def _axes(
    camera: Camera, wavelengths: Tensor | Sequence[float], inverse_depths: Tensor | Sequence[float]
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
    try:
        camera.glass.index(wavelengths)
        camera.mask_material.index(wavelengths)
    except InputError as error:
        problems.extend(error.problems)
    if problems:
        raise InputError(problems)
    return wavelengths, inverse_depths


def _check_height(height: Tensor) -> None:
    if height.ndim != 2 or height.shape[0] != height.shape[1] or not height.is_floating_point():
        raise InputError(
            f"a height map is square, [n, n], and real; got {tuple(height.shape)}, {height.dtype}"
        )


def _moved(bank: PsfBank, device: torch.device | str) -> PsfBank:
    values, rest = bank.values.to(device), bank.rest.to(device)
    return PsfBank(values, rest, bank.wavelengths, bank.inverse_depths, bank.transmission, bank.sampling)
