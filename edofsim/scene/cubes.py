"""Spectral cubes of the user's: a folder of pictures, a MAT file, or an EXR of the spectral layout."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from ..core.images import check_numbers, read_exr, read_picture
from ..errors import InputError
from ..recipe.sources import CubeFile
from . import spectra
from .depth_maps import load_mat, mat_value

_CHANNEL = re.compile(r"^S0\.(\d+[,.]?\d*)nm$")


def read_cube(source: CubeFile, base: Path, wavelengths: np.ndarray) -> np.ndarray:
    """Radiance (or reflectance under the recipe's illuminant) at `wavelengths`, float32 [band, y, x].

    wavelengths: [band] m. Bands between those of the file are interpolated linearly. Raises InputError for
    files that cannot be read, for bands outside the file's, and for values that are not finite.
    """
    what = f"spectral cube {source.path!r}"
    cube, nm = stored_cube(source, base)
    cube = at_bands(cube, nm, np.asarray(wavelengths) * 1e9, what)
    if source.illuminant is not None:
        cube = cube * spectra.illuminant(source.illuminant, wavelengths)[:, None, None]
    if source.scale != "auto":
        return (cube * source.scale).astype(np.float32)
    bright = np.percentile(cube.mean(axis=0), 99)
    if not bright > 0:
        raise InputError(f"{what} is black")
    return (cube / bright).astype(np.float32)


def stored_cube(source: CubeFile, base: Path) -> tuple[np.ndarray, np.ndarray]:
    """The numbers of a cube's file, cropped, [band, y, x], and the wavelengths of its bands in nm, ascending.

    Raises InputError for files that cannot be read and for values that are not finite.
    """
    path = Path(base) / source.path
    what = f"spectral cube {source.path!r}"
    if path.is_dir():
        cube, found = _folder(path, what), None
    elif path.suffix.lower() == ".mat":
        cube, found = _mat(path, source.key, what)
    elif path.suffix.lower() == ".exr":
        cube, found = _exr(path, what)
    else:
        raise InputError(f"{what} is neither a folder of pictures, nor a .mat, nor an .exr file that exists")
    nm = _wavelengths_nm(source, found, len(cube), what)
    if not np.isfinite(cube).all():
        raise InputError(f"{what} holds values that are not finite")
    left, top, right, bottom = source.crop
    cube = cube[:, top : cube.shape[1] - bottom, left : cube.shape[2] - right]
    if cube.size == 0:
        raise InputError(f"{what}: nothing is left of it after the crop {source.crop}")
    order = np.argsort(nm)
    return cube[order], nm[order]


def _wavelengths_nm(source: CubeFile, found: np.ndarray | None, count: int, what: str) -> np.ndarray:
    if source.start_nm is not None and source.step_nm is not None:
        return source.start_nm + source.step_nm * np.arange(count)
    if found is not None and len(found) == count:
        return found
    raise InputError(
        f"{what} does not say which wavelengths its {count} bands have; give start_nm and step_nm"
    )


def at_bands(cube: np.ndarray, nm: np.ndarray, wanted: np.ndarray, what: str) -> np.ndarray:
    """A cube [band, y, x] with bands at `nm`, ascending, interpolated linearly to the bands `wanted`."""
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


def _folder(path: Path, what: str) -> np.ndarray:
    """Pictures of one channel each in the order of their names, [band, y, x], full scale 1."""
    files = sorted(p for p in path.iterdir() if p.suffix.lower() in (".png", ".tif", ".tiff"))
    if not files:
        raise InputError(f"{what}: the folder holds no PNG or TIFF pictures")
    bands: list[np.ndarray] = []
    for file in files:
        picture = read_picture(file, what)
        check_numbers((len(files), *picture.shape[:2]), path, what)
        if picture.ndim == 3 and picture.shape[2] in (3, 4) and (picture[..., :3] == picture[..., :1]).all():
            picture = picture[..., 0]
        if picture.ndim != 2 or (bands and picture.shape != bands[0].shape):
            raise InputError(
                f"{what}: {file.name} has the shape {picture.shape}; the bands need one channel and one size"
            )
        full = np.iinfo(picture.dtype).max if picture.dtype.kind in "ui" else 1.0
        bands.append(picture / full)
    return np.stack(bands)


def _mat(path: Path, key: str | None, what: str) -> tuple[np.ndarray, np.ndarray | None]:
    """An array [y, x, band] of a MAT file, and its wavelengths in nm where the file has them.

    ISETCam's scenes pack their photons into integers between dmin and dmax; they are unpacked.
    """
    data = load_mat(path, what)
    value = np.asarray(mat_value(data, key, path, what))
    if value.ndim != 3 or value.dtype.kind not in "uif":
        raise InputError(
            f"{what}: {key or 'its variable'} has the shape {value.shape}; it needs [y, x, band]"
        )
    check_numbers(value.shape, path, what)
    cube = value.astype(np.float64)
    if value.dtype.kind == "u" and key is not None and "." in key:
        holder = mat_value(data, key.rpartition(".")[0], path, what)
        if hasattr(holder, "dmin") and hasattr(holder, "dmax"):
            low, high = float(holder.dmin), float(holder.dmax)
            cube = cube / np.iinfo(value.dtype).max * (high - low) + low
    return cube.transpose(2, 0, 1), _find_wavelengths(data, cube.shape[2])


def _find_wavelengths(data: object, count: int) -> np.ndarray | None:
    """The first array called wave, wavelength(s), lambda or bands that has as many numbers as the cube."""
    fields = (
        data if isinstance(data, dict) else {n: getattr(data, n) for n in getattr(data, "_fieldnames", [])}
    )
    for name, value in fields.items():
        if name.startswith("__"):
            continue
        if hasattr(value, "_fieldnames"):
            found = _find_wavelengths(value, count)
            if found is not None:
                return found
        elif (
            name.lower() in ("wave", "wavelength", "wavelengths", "lambda", "bands")
            and np.size(value) == count
        ):
            nm = np.asarray(value, float).ravel()
            return nm * 1e9 if nm.max() < 1e-3 else nm
    return None


def _exr(path: Path, what: str) -> tuple[np.ndarray, np.ndarray]:
    """The bands S0.420,000000nm, ... of the spectral layout (Fichet et al., JCGT 2021)."""
    channels = read_exr(path, what)
    bands = {float(m[1].replace(",", ".")): name for name in channels if (m := _CHANNEL.match(name))}
    if not bands:
        raise InputError(
            f"{what} has no channels like S0.550,000000nm; it has {', '.join(sorted(channels)[:8])}"
        )
    nm = np.array(sorted(bands))
    return np.stack([channels[bands[w]] for w in nm]).astype(np.float64), nm
