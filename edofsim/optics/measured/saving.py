"""A camera's PSFs as a file that the lens kind `measured` reads, and a recipe next to it that does."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from itertools import product
from pathlib import Path

import numpy as np
import torch

from ...core.files import whole, write_text
from ...core.images import write_exr
from ...errors import InputError
from ...recipe.camera import CameraRecipe
from ...recipe.written import toml_of
from ..camera import Camera
from ..field import relative_light
from ..masks.clear import ClearMask
from ..psf import psf_bank
from .files import ABOUT, Place, called


def save_bank(
    camera: Camera,
    path: Path,
    *,
    wavelengths_nm: Sequence[float],
    depths_m: Sequence[float],
    fields_deg: Sequence[float],
    device: str = "cpu",
) -> dict[str, Path]:
    """Write PSFs of a camera as .exr or .npz, and as .toml next to it the recipe of a camera that has them.

    fields_deg: angles above the axis, of a lens that varies, by where their light lands without distortion,
        which such a file does not hold; where its mask is not clear, PSFs do not turn with the place, and are
        those of all places to the right and upwards at these angles.

    Returns what was written. Raises InputError for an ending other than these, and as `psf_bank`.
    """
    if path.suffix.lower() not in (".exr", ".npz"):
        raise InputError(f"--save {path}: PSFs are written as .exr or .npz; name such a file")
    places = [(0.0, 0.0)]
    if camera.lens.varies:
        places = [(0.0, each) for each in fields_deg]
        if not isinstance(camera.mask, ClearMask) or camera.mask_given:
            ends = sorted({sign * each for each in fields_deg for sign in (-1, 1)})
            places = [(right, up) for up, right in product(ends, ends)]
    depths, wavelengths = sorted(1 / each for each in depths_m), sorted(wavelengths_nm)
    metres = torch.tensor(wavelengths, dtype=torch.float64) * 1e-9
    values: list[np.ndarray] = []
    light: list[float] = []
    for right, up in places:
        here = camera.seen_at((math.tan(math.radians(right)), math.tan(math.radians(up))))
        bank = psf_bank(here, metres, torch.tensor(depths, dtype=torch.float64), device=device)
        values.append(bank.values.cpu().numpy())
        light.append(relative_light(here))
    written = write_bank(
        path,
        np.stack(values),
        fields_deg=places,
        inverse_depths=depths,
        wavelengths_nm=wavelengths,
        pixel_um=camera.pixel * 1e6,
        light=light,
    )
    about = f"PSFs of the camera {camera.recipe.name}, from {path.name}."
    recipe = write_text(path.with_suffix(".toml"), toml_of(_camera_of(camera, path), about))
    return {"PSFs to photograph with": written, "camera with these PSFs": recipe}


def _camera_of(camera: Camera, path: Path) -> CameraRecipe:
    """A camera whose lens is a file: of the focal length that puts its sensor where the camera's is."""
    given = camera.recipe
    focal = 1 / (1 / given.focus.distance_m + 1 / camera.sensor_distance)
    lens = {
        "kind": "measured",
        "file": path.name,
        "focal_length_mm": float(f"{focal * 1e3:.10g}"),
        "f_number": float(f"{focal / (2 * camera.aperture_radius):.6g}"),
    }
    focus = {"distance_m": given.focus.distance_m, "wavelength_nm": given.focus.wavelength_nm}
    kept = given.model_dump(exclude_unset=True, include={"sensor", "psf"})
    psf = {key: value for key, value in kept.get("psf", {}).items() if key != "pupil_sampling_um"}
    new = {"name": f"{given.name[:55]}-measured", "lens": lens, "focus": focus, "psf": psf}
    return CameraRecipe.model_validate({**new, "sensor": kept.get("sensor", {})})


def write_bank(
    path: Path,
    values: np.ndarray,
    *,
    fields_deg: Sequence[Place],
    inverse_depths: Sequence[float],
    wavelengths_nm: Sequence[float],
    pixel_um: float,
    light: Sequence[float],
) -> Path:
    """Write PSFs with all that `read_bank` asks for. Returns the path; raises InputError for another ending.

    path: ends in .exr or .npz.
    values: [field, depth, band, y, x], upright, fractions of light about the pixel n // 2.
    fields_deg, inverse_depths, wavelengths_nm, pixel_um, light: as of `Stated`.
    """
    about = {
        "fields_deg": list(fields_deg),
        "inverse_depths_per_m": list(inverse_depths),
        "wavelengths_nm": list(wavelengths_nm),
        "pixel_um": pixel_um,
        "orientation": "upright",
        "centre": "pixel",
        "normalisation": "light",
        "light": list(light),
    }
    if path.suffix.lower() == ".npz":
        with whole(path) as temporary, temporary.open("wb") as file:
            np.savez_compressed(file, values=values.astype(np.float32), **about)
        return path
    if path.suffix.lower() != ".exr":
        raise InputError(f"{path}: PSFs are written as .exr or .npz; name such a file")
    planes = {
        called(place, depth, nm): values[p, d, b]
        for p, place in enumerate(fields_deg)
        for d, depth in enumerate(inverse_depths)
        for b, nm in enumerate(wavelengths_nm)
    }
    return write_exr(path, planes, {ABOUT: json.dumps(about)})
