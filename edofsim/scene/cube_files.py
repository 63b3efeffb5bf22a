"""The files that spectral cubes come in, each read to the same thing."""

from __future__ import annotations

import logging
import re
import warnings
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..core import hdf5
from ..core.decoded import check_tiff_page, quiet_tifffile, read_picture
from ..core.images import read_exr
from ..core.limits import check_numbers, existing
from ..core.measurements import load_mat, mat_value, read_numbers
from ..errors import InputError, first_line
from ..recipe.sources import CubeFile
from .wavelengths import natural, of_names, unit_of

CHANNEL = re.compile(r"(?:^|[._ ])(\d+[,.]?\d*)nm$")
PICTURES = (".png", ".tif", ".tiff")
ENVI_DATA = (".raw", ".img", ".dat", ".bil", ".bip", ".bsq", ".bin", "")
FILES = (".mat", ".exr", ".hdr", ".npy", ".npz", ".tif", ".tiff", *hdf5.SUFFIXES, *ENVI_DATA[:-1])
"""Suffixes of cubes that are one file."""
LISTS = ("wave", "waves", "wavelength", "wavelengths", "lambda", "wl", "bands", "centers", "band_centers")
KINDS = (
    "a folder of PNG or TIFF pictures, ENVI (.hdr), MAT, HDF5, NPY, a TIFF with a page a band, or a spectral "
    "EXR"
)


@dataclass(frozen=True)
class StoredCube:
    """values: float64 [band, y, x].
    waves: [band] as the file lists them, in `unit`, or None.
    said: phrases of what was taken for granted.
    """

    values: np.ndarray
    waves: np.ndarray | None = None
    unit: str | None = None
    said: tuple[str, ...] = ()


def read_stored(source: CubeFile, base: Path, what: str) -> StoredCube:
    """A cube's file, by its suffix. Raises InputError for what cannot be read."""
    path = Path(base) / source.path
    if path.is_dir():
        return _folder(path, what)
    if not path.exists():
        raise InputError(f"{what}: there is no file or folder {str(path)!r}")
    suffix = path.suffix.lower()
    if suffix == ".mat":
        return _mat(path, source, what)
    if suffix == ".exr":
        return _exr(path, what)
    if suffix in (".npy", ".npz"):
        return _array(read_numbers(str(path), source.key, Path(), what), None, source, what, "likely")
    if suffix in hdf5.SUFFIXES:
        return _hdf5(path, source, what, "likely")
    if suffix in (".tif", ".tiff"):
        return _tiff(path, what)
    if suffix in (".hdr", *ENVI_DATA):
        return _envi(path, what)
    raise InputError(f"{what} is of no kind that is read: {KINDS}")


def _array(
    values: np.ndarray, waves: np.ndarray | None, source: CubeFile, what: str, usual: str
) -> StoredCube:
    """An array of three axes with its bands brought to the front.

    usual: which axis the bands are where the recipe leaves it open, the `last` or the one that is `likely`.
    """
    if values.ndim != 3 or values.dtype.kind not in "buif":
        raise InputError(
            f"{what}: {source.key or 'its variable'} has the shape {values.shape}; it needs [y, x, band]"
        )
    axis = source.bands
    if axis is None and usual == "likely":
        axis = _likely(values.shape, source, waves)
    cube = values if axis == "first" else np.moveaxis(values, 2, 0)
    order = "[band, y, x]" if axis == "first" else "[y, x, band]"
    return StoredCube(cube.astype(np.float64), waves, None, (f"an array {order}",))


def _likely(shape: tuple[int, ...], source: CubeFile, waves: np.ndarray | None) -> str:
    """Which axis the bands are: the one with as many as there are wavelengths, else the first where it is
    less than half of both others, else the last."""
    first, middle, last = shape
    listed = len(source.wavelengths_nm) if source.wavelengths_nm else 0 if waves is None else len(waves)
    if (first == listed) != (last == listed):
        return "first" if first == listed else "last"
    return "first" if 2 * first <= min(middle, last) else "last"


def _folder(path: Path, what: str) -> StoredCube:
    """Pictures of one channel each in the order of the numbers in their names, full scale 1."""
    every = sorted((p for p in path.iterdir() if p.suffix.lower() in PICTURES), key=lambda p: natural(p.stem))
    if not every:
        raise InputError(f"{what}: the folder holds no PNG or TIFF pictures")
    files, left = _alike(every, what)
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
    said = [f"{len(files)} bands from {files[0].name} to {files[-1].name}"]
    said += [f"no bands: {', '.join(p.name for p in left[:6])}"] if left else []
    waves, unit = of_names([p.stem for p in files])
    return StoredCube(np.stack(bands), waves, unit, tuple(said))


def _alike(files: list[Path], what: str) -> tuple[list[Path], list[Path]]:
    """The files that most have the name of but for its numbers, and those that are left over.

    Raises InputError where it is not clear which are the bands.
    """
    shapes = [re.sub(r"\d+(?:[.,]\d+)?", "#", p.stem.lower()) for p in files]
    counts = Counter(shapes).most_common()
    if len(counts) == 1 or counts[0][1] == 1:
        return files, []
    if counts[0][1] == counts[1][1]:
        raise InputError(
            f"{what}: the folder holds as many pictures called {counts[0][0]!r} as {counts[1][0]!r}; keep "
            "only "
            "the bands in it"
        )
    usual = counts[0][0]
    return (
        [p for p, shape in zip(files, shapes, strict=True) if shape == usual],
        [p for p, shape in zip(files, shapes, strict=True) if shape != usual],
    )


def _mat(path: Path, source: CubeFile, what: str) -> StoredCube:
    """An array [y, x, band] of a MAT file, and its wavelengths where the file has them.

    ISETCam's scenes pack their photons into integers between dmin and dmax; they are unpacked.
    """
    existing(path, what)
    if hdf5.is_hdf5(path):
        return _hdf5(path, source, what, "last")
    key, data = source.key, load_mat(path, what)
    value = np.asarray(mat_value(data, _only_cube(data) if key is None else key, path, what))
    check_numbers(value.shape, path, what)
    stored = _array(value, _find_wavelengths(data, value.shape), source, what, "last")
    if value.dtype.kind == "u" and key is not None and "." in key:
        holder = mat_value(data, key.rpartition(".")[0], path, what)
        if hasattr(holder, "dmin") and hasattr(holder, "dmax"):
            low, high = float(holder.dmin), float(holder.dmax)
            unpacked = stored.values / np.iinfo(value.dtype).max * (high - low) + low
            return StoredCube(unpacked, stored.waves, None, (*stored.said, "unpacked from dmin to dmax"))
    return stored


def _only_cube(data: dict[str, object]) -> str | None:
    """The only variable of three axes, where there is one."""
    cubes = [name for name, value in data.items() if not name.startswith("__") and np.ndim(value) == 3]  # pyrefly: ignore
    return cubes[0] if len(cubes) == 1 else None


def _find_wavelengths(data: object, shape: tuple[int, ...]) -> np.ndarray | None:
    """The first array that is called wavelengths and has as many numbers as one of the cube's axes."""
    fields = (
        data if isinstance(data, dict) else {n: getattr(data, n) for n in getattr(data, "_fieldnames", [])}
    )
    for name, value in fields.items():
        if name.startswith("__"):
            continue
        if hasattr(value, "_fieldnames"):
            found = _find_wavelengths(value, shape)
            if found is not None:
                return found
        elif name.lower() in LISTS and np.size(value) in shape:  # pyrefly: ignore
            return np.asarray(value, float).ravel()
    return None


def _hdf5(path: Path, source: CubeFile, what: str, usual: str) -> StoredCube:
    found = hdf5.read_hdf5(path, source.key, what)
    cubes = [values for values in found.values() if values.ndim == 3]
    if not cubes:
        raise InputError(f"{what}: {str(path)!r} holds no array [y, x, band]; it holds {', '.join(found)}")
    named = {name.rpartition("/")[2].lower(): values for name, values in found.items()}
    waves = next(
        (named[name].ravel() for name in LISTS if name in named and named[name].size in cubes[0].shape), None
    )
    return _array(cubes[0], waves, source, what, usual)


def _exr(path: Path, what: str) -> StoredCube:
    """The bands S0.420,000000nm, ... of the spectral layout (Fichet et al., JCGT 2021), or 420nm, ..."""
    channels = read_exr(path, what)
    bands = {float(m[1].replace(",", ".")): name for name in channels if (m := CHANNEL.search(name))}
    if not bands:
        raise InputError(
            f"{what} has no channels like S0.550,000000nm; it has {', '.join(sorted(channels)[:8])}"
        )
    nm = np.array(sorted(bands))
    return StoredCube(np.stack([channels[bands[w]] for w in nm]).astype(np.float64), nm, "nm")


def _tiff(path: Path, what: str) -> StoredCube:
    """A TIFF with a page a band, or a channel a band; whole numbers have full scale 1."""
    existing(path, what)
    try:
        with quiet_tifffile().TiffFile(path) as file:
            series = file.series[0]
            check_numbers(series.shape, path, what)
            check_tiff_page(series.keyframe, path, what)
            axes = "".join(
                a for a, size in zip(series.axes, series.shape, strict=True) if size > 1 or a in "YX"
            )
            values = np.asarray(series.asarray()).reshape(
                [size for a, size in zip(series.axes, series.shape, strict=True) if size > 1 or a in "YX"]
            )
            parts = len(file.series)
    except InputError:
        raise
    except Exception as error:  # of many kinds
        raise InputError(f"{what}: {str(path)!r} cannot be read as TIFF: {first_line(error)}") from error
    if values.ndim != 3 or parts > 1 or not {"Y", "X"} <= set(axes):
        raise InputError(
            f"{what}: {str(path)!r} holds {parts} arrays, the first of shape {values.shape}; it needs one "
            "page, or "
            "one channel, a band, all of one size"
        )
    at = next(i for i, a in enumerate(axes) if a not in "YX")
    full = np.iinfo(values.dtype).max if values.dtype.kind in "ui" else 1.0
    kind = "page" if at == 0 else "channel"
    return StoredCube(np.moveaxis(values, at, 0) / full, None, None, (f"a {kind} a band",))


def _envi(path: Path, what: str) -> StoredCube:
    """ENVI: a header in text and the numbers in a file next to it."""
    header = path if path.suffix.lower() == ".hdr" else path.with_suffix(".hdr")
    header = header if header.is_file() else path.with_name(path.name + ".hdr")
    if not header.is_file():
        raise InputError(f"{what}: {str(path)!r} has no ENVI header next to it ({header.stem}.hdr)")
    with header.open("rb") as file:
        if file.read(4) != b"ENVI":
            raise InputError(f"{what}: {str(header)!r} is no ENVI header (it does not begin with ENVI)")
    stems = [path, *(header.with_suffix(s) for s in ENVI_DATA), header.with_suffix("")]
    data = next((p for p in stems if p.is_file() and p != header), None)
    if data is None:
        raise InputError(
            f"{what}: {str(header)!r} has no file of numbers next to it ({header.stem}.raw, .img, ...)"
        )
    try:
        from spectral.io import envi
    except ImportError:
        raise InputError(f"{what}: ENVI files need spectral: pip install 'edofsim[cubes]'") from None
    logging.getLogger("spectral").setLevel(logging.CRITICAL)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # capital letters in keys, and the like
            said = envi.read_envi_header(str(header))
            shape = tuple(int(said[key]) for key in ("lines", "samples", "bands"))
            check_numbers(shape, header, what)
            if said.get("file type", "ENVI Standard").strip().lower() not in ("envi standard", "envi"):
                raise InputError(f"{what}: {str(header)!r} is of the type {said['file type']!r}, no image")
            if str(said.get("file compression", "0")).strip() not in ("", "0"):
                raise InputError(f"{what}: {str(header)!r} is compressed; save it without")
            image = envi.open(str(header), str(data))
            values = np.array(image.load(dtype=np.float64, scale=True))
        return _of_envi(values, said, header, what)
    except InputError:
        raise
    except Exception as error:  # of many kinds
        raise InputError(f"{what}: {str(header)!r} cannot be read as ENVI: {first_line(error)}") from error


def _of_envi(values: np.ndarray, header: dict[str, object], path: Path, what: str) -> StoredCube:
    """What an ENVI header says of its bands: wavelengths, their unit, and which are bad."""
    cube = np.moveaxis(values, 2, 0)
    words = str(header.get("wavelength units", ""))
    said: list[str] = []
    listed = header.get("wavelength")
    waves = None if not isinstance(listed, list) else np.array([float(w) for w in listed])
    unit = unit_of(words)
    if waves is not None and unit is None and words.strip().lower() not in ("", "unknown"):
        raise InputError(
            f"{what}: {str(path)!r} has wavelengths in {words!r}; give wavelengths_nm in their place"
        )
    bad = header.get("bbl")
    if isinstance(bad, list) and len(bad) == len(cube):
        keep = np.array([float(flag) != 0 for flag in bad])
        if not keep.all() and keep.any():
            said.append(f"{int((~keep).sum())} bands that its bbl calls bad are left out")
            cube, waves = cube[keep], None if waves is None or len(waves) != len(keep) else waves[keep]
    ignored = header.get("data ignore value")
    if ignored is not None and (cube == float(str(ignored))).any():
        share = float((cube == float(str(ignored))).any(axis=0).mean())
        raise InputError(
            f"{what}: {share:.1%} of its pixels hold no data ({str(ignored).strip()}); cut them off by crop"
        )
    return StoredCube(cube, waves, unit, tuple(said))
