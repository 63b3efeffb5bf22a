"""Spectral cubes of the user's, at the bands of a view."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..errors import InputError
from ..recipe.sources import CubeFile
from . import spectra
from .cube_files import read_stored
from .wavelengths import chosen_nm


def read_cube(source: CubeFile, base: Path, wavelengths: np.ndarray) -> tuple[np.ndarray, str]:
    """Radiance (or reflectance under the recipe's illuminant) at `wavelengths`, float32 [band, y, x], and
    what the file was taken for.

    wavelengths: [band] m. Bands between those of the file are interpolated linearly.

    Raises InputError for files that cannot be read, for bands outside the file's, and for values that are not
    finite.
    """
    what = f"spectral cube {source.path!r}"
    cube, nm, said = stored_cube(source, base)
    cube = at_bands(cube, nm, np.asarray(wavelengths) * 1e9, what)
    if source.illuminant is not None:
        cube = cube * spectra.illuminant(source.illuminant, wavelengths)[:, None, None]
    if source.scale != "auto":
        return (cube * source.scale).astype(np.float32), said
    bright = np.percentile(cube.mean(axis=0), 99)
    if not bright > 0:
        raise InputError(f"{what} is black")
    return (cube / bright).astype(np.float32), said


def stored_cube(source: CubeFile, base: Path) -> tuple[np.ndarray, np.ndarray, str]:
    """The numbers of a cube's file, cropped, [band, y, x], the wavelengths of its bands in nm, ascending, and
    a sentence that says what was taken for granted.

    Raises InputError for files that cannot be read and for values that are not finite.
    """
    what = f"spectral cube {source.path!r}"
    stored = read_stored(source, base, what)
    cube = stored.values
    nm, where = chosen_nm(source, stored.waves, stored.unit, len(cube), what)
    if not np.isfinite(cube).all():
        share = 1 - float(np.isfinite(cube).mean())
        raise InputError(f"{what} holds values that are not finite ({share:.1%} of them)")
    left, top, right, bottom = source.crop
    cube = cube[:, top : cube.shape[1] - bottom, left : cube.shape[2] - right]
    if cube.size == 0:
        raise InputError(f"{what}: nothing is left of it after the crop {source.crop}")
    order = np.argsort(nm)
    return cube[order], nm[order], "; ".join([*stored.said, where])


def at_bands(cube: np.ndarray, nm: np.ndarray, wanted: np.ndarray, what: str) -> np.ndarray:
    """A cube [band, y, x] with bands at `nm`, ascending, interpolated linearly to the bands `wanted`.

    cube: [band, y, x].
    nm: [band], nanometres, ascending.
    wanted: [wanted], nanometres.

    Raises InputError for bands outside the cube.
    """
    if wanted.min() < nm[0] - 1e-6 or wanted.max() > nm[-1] + 1e-6:
        raise InputError(
            f"{what} goes from {nm[0]:g} to {nm[-1]:g} nm, the recipe's bands from {wanted.min():g} to "
            f"{wanted.max():g} nm; choose [bands] inside the cube"
        )
    if len(nm) == 1:
        return np.repeat(cube, len(wanted), axis=0).astype(np.float64)
    upper = np.clip(np.searchsorted(nm, wanted), 1, len(nm) - 1)
    share = np.clip((wanted - nm[upper - 1]) / (nm[upper] - nm[upper - 1]), 0, 1)[:, None, None]
    return cube[upper - 1] * (1 - share) + cube[upper] * share
