"""The surface of a mask: read, designed or trained, made, and sampled on the grid of the pupil."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import TypeVar

import numpy as np
import torch
from safetensors import SafetensorError, safe_open
from torch import Tensor

from ..core.limits import existing
from ..core.measurements import read_numbers
from ..errors import InputError, first_line
from .camera import Camera, check_thin
from .fabrication import height_error, made_height, makes_squares, wave_height
from .grid import PupilGrid, resample
from .masks import PhaseMask, asked
from .masks.height_map import HeightMapMask

KEY = "height_m"
Phase = TypeVar("Phase", Tensor, float)

TRAINED, TRAINED_SAMPLING = "mask.height_m", "mask.sampling_m"
"""Keys of the map, and of its sampling in metres, in the checkpoint of a training."""


UNITS = {"m": 1.0, "mm": 1e-3, "um": 1e-6, "nm": 1e-9}
RIM = 0.75
"""Samples inside the pupil's rim from which a cell without a height may lie: it takes the nearest one's."""


def load_height_map(
    path: Path, *, unit: str | float | None = None, key: str | None = None
) -> tuple[Tensor, float | None]:
    """A height map [n, n] in metres, float64, NaN where the file has no height, and its pitch [m] where the
    file states it.

    Reads .safetensors (key `height_m`, or the map in the checkpoint of a training) and .npy in metres, and
    what `core.measurements` reads.

    unit: of the numbers, by name or in metres.
    key: array in the file.

    Raises InputError for a file that is missing, no such map, or in no stated unit.
    """
    what = "mask.file"
    existing(path, what)
    pitch = None
    if path.suffix.lower() == ".safetensors":
        if unit not in (None, "m", 1.0):
            raise InputError(f"{what}: {path} is in metres, as .safetensors are; leave out mask.unit")
        height, pitch = _saved(path)
    else:
        if unit is None and path.suffix.lower() != ".npy":
            raise InputError(f'{what}: {path} does not say its unit; set mask.unit = "m", "mm", "um" or "nm"')
        height = torch.from_numpy(read_numbers(str(path), key, Path(), what).astype(float))
    if height.ndim != 2 or height.shape[0] != height.shape[1] or height.is_complex():
        raise InputError(
            f"mask.file: {path} has shape {tuple(height.shape)}; a height map is square, [n, n], real"
        )
    height = height.double() * (UNITS.get(unit, 1.0) if isinstance(unit, str) else unit or 1.0)
    if bool(torch.isinf(height).any()) or bool(torch.isnan(height).all()):
        raise InputError(f"mask.file: {path} holds values that are not finite")
    check_thin(height.nan_to_num(0), f"mask.file: {path}")
    return height, pitch


def _saved(path: Path) -> tuple[Tensor, float | None]:
    """The map of a safetensors file, and its pitch [m] where the file states it."""
    try:
        with safe_open(str(path), "pt") as file:
            if TRAINED in file.keys():  # noqa: SIM118 - no mapping
                return file.get_tensor(TRAINED), float(file.get_tensor(TRAINED_SAMPLING))
            height = file.get_tensor(KEY)
            stated = json.loads((file.metadata() or {}).get("edofsim", "{}")).get("pitch_um")
            return height, None if stated is None else float(stated) * 1e-6
    except (OSError, EOFError, ValueError, SafetensorError, TypeError) as error:
        raise InputError(f"mask.file: {path} is not a height map: {first_line(error)}") from error


def _without_border(height: Tensor, pitch: float, radius: float, name: str) -> Tensor:
    """Heights without NaN: outside the pupil, where no light passes, each takes the nearest known one.

    Raises InputError for NaN within."""
    missing = torch.isnan(height)
    if not bool(missing.any()):
        return height
    apart = PupilGrid(height.shape[0], pitch, radius).radius_squared().sqrt()
    within = missing & (apart < radius - RIM * pitch)
    if bool(within.any()):
        row, column = (int(index[0]) for index in torch.nonzero(within, as_tuple=True))
        raise InputError(
            f"mask.file: {name} has no finite height in {int(within.sum())} samples within the pupil, the "
            "first in "
            f"row {row}, column {column}; fill them"
        )
    return nearest_known(height, ~missing)


def nearest_known(values: Tensor, known: Tensor) -> Tensor:
    """Values [n, n], each the nearest of those that are known.

    values: [n, n].
    known: bool [n, n].
    """
    from scipy.ndimage import distance_transform_edt

    nearest = distance_transform_edt(~known.cpu().numpy(), return_distances=False, return_indices=True)
    rows, columns = torch.from_numpy(np.asarray(nearest)).long().to(values.device)
    return values[rows, columns]


def _check_unit(height: Tensor, camera: Camera, mask: HeightMapMask) -> None:
    """Raises InputError for a .npy of no stated unit whose neighbouring samples lie waves apart: no surface
    is sampled so, and numbers of another unit look so."""
    if mask.unit is not None or height.shape[0] < 3:
        return
    steps = torch.cat([height.diff(dim=0).flatten(), height.diff(dim=1).flatten()]).abs()
    waves = float(steps[torch.isfinite(steps)].median()) / _wave(camera)
    if waves > 1:
        raise InputError(
            f"mask.file: {mask.file} has steps of {waves:.3g} waves between its samples, if its numbers "
            "are metres: "
            'set mask.unit = "mm", "um" or "nm" if they are those, or "m" if they are metres'
        )


def designed_map(camera: Camera) -> tuple[Tensor, float] | None:
    """The camera's height map, or the recipe's free one (float64), in metres, and its pitch [m]; None where
    the mask has a formula.

    Raises InputError for a map that is larger than the pupil, does not cover it, or states another pitch.
    """
    if camera.height_map is not None:
        return camera.height_map, _pitch_of(camera, camera.height_map)
    mask = camera.mask
    if not isinstance(mask, HeightMapMask):
        return None
    pitch = mask.pitch_um * 1e-6
    if mask.file is None:
        samples = natural_samples(camera, pitch)
        return torch.zeros(samples, samples, dtype=torch.float64), pitch
    height, stated = load_height_map(camera.base / mask.file, unit=mask.unit, key=mask.key)
    if stated is not None and abs(stated / pitch - 1) > 1e-6:
        raise InputError(
            f"mask.pitch_um = {mask.pitch_um:g}, but {mask.file} was sampled at {stated * 1e6:g} um"
        )
    check_size(camera, height.shape[-1], pitch)
    if stated is None:
        _check_unit(height, camera, mask)
    return _without_border(height, pitch, camera.aperture_radius, mask.file), pitch


def natural_samples(camera: Camera, pitch: float) -> int:
    """How many samples of `pitch` [m] cover the pupil's diameter: 239 for 5 mm at 21 um."""
    return math.ceil(2 * camera.aperture_radius / pitch - 1e-9)


def check_size(camera: Camera, samples: int, pitch: float) -> None:
    """Raise InputError unless `samples` cells of `pitch` [m] cover the pupil, a cell to spare at most."""
    width, diameter = samples * pitch, 2 * camera.aperture_radius
    if diameter - 1e-9 <= width <= diameter + 2 * pitch:
        return
    wrong = "is larger than" if width > diameter else "does not cover"
    raise InputError(
        f"the mask {wrong} the pupil: {samples} samples of {pitch * 1e6:g} um make {width * 1e3:.4g} mm, the"
        f" pupil is {diameter * 1e3:.4g} mm across; use {natural_samples(camera, pitch)} samples"
    )


def given_pitch(camera: Camera) -> float | None:
    """Pitch [m] of the camera's height map, given in place of the recipe's mask; None where none is given.

    That of the recipe's own map if it has one, else the one at which the samples just cover the pupil.
    """
    return None if camera.height_map is None else _pitch_of(camera, camera.height_map)


def _pitch_of(camera: Camera, height: Tensor) -> float:
    mask, samples = camera.mask, height.shape[-1]
    if not isinstance(mask, HeightMapMask):
        return 2 * camera.aperture_radius / samples
    check_size(camera, samples, mask.pitch_um * 1e-6)
    return mask.pitch_um * 1e-6


def design_phase_to_height(camera: Camera, phase: Phase) -> Phase:
    """Height [m] that delays the mask's design wavelength by `phase` [rad]: Akpinar et al., Eq. `dtophi`."""
    wavelength = design_wavelength(camera)
    return phase * (wavelength / (2 * math.pi * (float(camera.mask_material.index(wavelength)) - 1)))


def surface(camera: Camera, grid: PupilGrid, seed: int | None = None) -> Tensor | None:
    """Height of the mask as it was made, on the grid of the pupil [samples, samples], metres.

    Gradients reach the camera's height map.

    seed: of the fabrication error in place of the recipe's. None for masks that only block light.
    """
    given = designed_map(camera)
    fabrication = camera.recipe.fabrication
    stage = grid
    if fabrication is not None:
        pitch = fabrication.pitch_um * 1e-6 if fabrication.pitch_um else (given[1] if given else grid.pitch)
        stage = PupilGrid(natural_samples(camera, pitch), pitch, grid.radius)
    if given is None:
        mask = camera.mask
        phase = asked(mask, "phase", lambda: mask.phase(stage))
        if phase is None:
            return None
        designed = design_phase_to_height(camera, phase)
    else:
        designed = resample(given[0], given[1], stage, _wave(camera))
    if fabrication is None:
        return designed
    made = made_height(designed, fabrication, camera.mask_material)
    error = height_error(made, fabrication, fabrication.seed if seed is None else seed)
    if makes_squares(fabrication):
        return _squares(made + error, stage, grid)
    # errors of samples are squares either way: interpolated between samples they would be smaller than stated
    smooth = resample(made, stage.pitch, grid, _wave(camera, fabrication.wrap_wavelength_nm))
    return smooth + _squares(error, stage, grid)


def design_wavelength(camera: Camera) -> float:
    """Wavelength [m] that the mask is designed for; where it only blocks light, a height map in its place is
    designed for what maps are by default."""
    mask = camera.mask if isinstance(camera.mask, PhaseMask) else HeightMapMask()
    return mask.design_wavelength_nm * 1e-9


def _wave(camera: Camera, wavelength_nm: float | None = None) -> float:
    """Height [m] of one wave of the mask: of its design wavelength unless another is stated."""
    at = design_wavelength(camera) if wavelength_nm is None else wavelength_nm * 1e-9
    return wave_height(at, camera.mask_material)


def _squares(made: Tensor, stage: PupilGrid, grid: PupilGrid) -> Tensor:
    """The made surface as the flat squares it consists of, looked up at the cell centres of a finer grid."""
    if stage.samples == grid.samples and abs(stage.pitch / grid.pitch - 1) < 1e-9:
        return made
    position = grid.centres / stage.pitch + stage.samples / 2
    index = position.floor().long().clamp(0, stage.samples - 1).to(made.device)
    return made[index][:, index]
