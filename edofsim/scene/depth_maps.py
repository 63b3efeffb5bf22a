"""Depth maps of the user's: read from many formats, turned into inverse depth, holes filled."""

from __future__ import annotations

import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np

from ..core.images import check_numbers, check_pixels, existing, read_exr, read_picture
from ..core.shipped import installed
from ..errors import InputError, first_line
from ..recipe.sources import DepthMap
from .pictures import read_pfm

SKIMAGE = "skimage:"
"""Prefix of pictures and disparities that come inside scikit-image."""


def read_inverse_depth(source: DepthMap, base: Path) -> np.ndarray:
    """Inverse depth in 1/m, float64 [y, x], NaN in holes, 0 at infinity.

    Depth of a disparity d is baseline focal / (d + offset), Scharstein et al., GCPR 2014. Raises InputError
    for files that cannot be read, for the wrong shape, and where nothing is known.
    """
    values = read_numbers(source.path, source.key, Path(base), "depth map").astype(float) * source.unit
    if values.ndim == 3 and values.shape[2] in (3, 4) and np.array_equal(values[..., 0], values[..., 1]):
        values = values[..., 0]
    if values.ndim != 2:
        raise InputError(f"depth map {source.path!r} has the shape {values.shape}; it needs [y, x]")
    with np.errstate(divide="ignore", invalid="ignore"):
        if source.holds == "depth":
            inverse = np.where(values > 0, 1 / values, np.nan)
        elif source.holds == "inverse_depth":
            inverse = np.where(np.isfinite(values) & (values >= 0), values, np.nan)
        else:
            assert source.baseline_mm is not None and source.focal_length_px is not None
            shifted = values + source.disparity_offset_px
            known = np.isfinite(values) & (values != 0) & (shifted > 0)
            inverse = np.where(known, shifted / (source.baseline_mm * 1e-3 * source.focal_length_px), np.nan)
    inverse = inverse / source.scale
    if not np.isfinite(inverse).any():
        raise InputError(f"depth map {source.path!r} holds no depth at all")
    return inverse


def read_numbers(name: str, key: str | None, base: Path, what: str) -> np.ndarray:
    """The array of a file, by its suffix. Objects are never unpickled. Raises InputError."""
    if name.startswith(SKIMAGE):
        return packaged(name.removeprefix(SKIMAGE), what)
    path = base / name
    readers = {".npy": _numpy, ".npz": _numpy, ".mat": read_mat, ".exr": _exr}
    suffix = path.suffix.lower()
    if suffix in readers:
        return readers[suffix](path, key, what)
    if suffix == ".pfm":
        return read_pfm(path, what)
    if suffix == ".dpt":
        return read_sintel(path, what)
    return read_picture(path, what)


def usual_unit(depths: np.ndarray) -> float:
    """Metres in one unit of what a depth map holds, where nobody says: whole numbers are millimetres."""
    return 0.001 if np.issubdtype(depths.dtype, np.integer) else 1.0


def read_sintel(path: Path, what: str) -> np.ndarray:
    """A depth map of MPI Sintel (D. J. Butler et al., ECCV 2012), float32 [y, x] in metres."""
    existing(path, what)
    with path.open("rb") as file:
        head = file.read(12)
        tag = np.frombuffer(head[:4], "<f4") if len(head) == 12 else np.zeros(1)
        if tag[0] != np.float32(202021.25):
            raise InputError(f"{what}: {str(path)!r} does not begin as Sintel's .dpt files do (202021.25)")
        columns, rows = np.frombuffer(head[4:], "<i4").tolist()
        if columns < 1 or rows < 1:
            raise InputError(f"{what}: {str(path)!r} says that it has {columns} x {rows} pixels")
        check_pixels(rows, columns, path, what)
        body = file.read(4 * rows * columns)
    if len(body) < 4 * rows * columns:
        raise InputError(f"{what}: {str(path)!r} is cut short")
    return np.frombuffer(body, "<f4").reshape(rows, columns).copy()


def packaged(name: str, what: str) -> np.ndarray:
    """A picture or disparity map that comes inside scikit-image."""
    folder = installed("skimage") / "data"
    for suffix in (".png", ".jpg", ".npz"):
        path = folder / f"{name}{suffix}"
        if path.parent == folder and path.is_file():
            return _numpy(path, None, what) if suffix == ".npz" else read_picture(path, what)
    raise InputError(f"{what}: scikit-image brings no {name!r} in its package")


def _numpy(path: Path, key: str | None, what: str) -> np.ndarray:
    existing(path, what)
    try:
        loaded = np.load(path, mmap_mode="r", allow_pickle=False)
        if isinstance(loaded, np.ndarray):
            return _numbers(loaded, path, what)
        names = loaded.files
        if key is None and len(names) != 1:
            raise InputError(
                f'{what}: {str(path)!r} holds {", ".join(names)}; say which with key = "{names[0]}"'
            )
        if key is not None and key not in names:
            raise InputError(f"{what}: {str(path)!r} holds no {key!r}; it holds {', '.join(names)}")
        with zipfile.ZipFile(path) as archive, archive.open(f"{key or names[0]}.npy") as member:
            version = np.lib.format.read_magic(member)
            read_header = np.lib.format.read_array_header_1_0
            if version != (1, 0):
                read_header = np.lib.format.read_array_header_2_0
            check_numbers(read_header(member)[0], path, what)
        return _numbers(loaded[key or names[0]], path, what)
    except InputError:
        raise
    except Exception as error:  # damaged archives raise many kinds
        raise InputError(f"{what}: {str(path)!r} cannot be read as numbers: {first_line(error)}") from error


def _numbers(array: np.ndarray, path: Path, what: str) -> np.ndarray:
    if array.dtype.kind not in "buif" or array.size == 0:
        raise InputError(f"{what}: {str(path)!r} holds {array.dtype}, not numbers")
    check_numbers(array.shape, path, what)
    return np.array(array)


def _exr(path: Path, key: str | None, what: str) -> np.ndarray:
    channels = read_exr(path, what)
    name = key or ("Z" if "Z" in channels else None)
    if name is None and len(channels) == 1:
        name = next(iter(channels))
    if name not in channels:
        raise InputError(
            f"{what}: {str(path)!r} has no channel {name or 'Z'!r}; it has {', '.join(channels)}"
        )
    return channels[name]


def read_mat(path: Path, key: str | None, what: str) -> np.ndarray:
    """An array of a MAT file (up to version 7); dots in `key` go into its structures."""
    return _numbers(np.asarray(mat_value(load_mat(path, what), key, path, what)), path, what)


def load_mat(path: Path, what: str) -> dict[str, object]:
    """All of a MAT file; structures become objects with attributes."""
    existing(path, what)
    # Some damaged MAT files crash the reader of SciPy, which would take this process with it
    if _crashes(path):
        raise InputError(f"{what}: {str(path)!r} is a damaged MAT file; save it again, or use .npz")
    from scipy.io import loadmat

    try:
        return loadmat(path, squeeze_me=True, struct_as_record=False)
    except NotImplementedError:
        raise InputError(
            f"{what}: {str(path)!r} is a MAT file of version 7.3; save it with version 7"
        ) from None
    except Exception as error:  # damaged files raise many kinds
        raise InputError(
            f"{what}: {str(path)!r} cannot be read as a MAT file: {first_line(error)}"
        ) from error


def _crashes(path: Path) -> bool:
    """Whether SciPy's reader crashes on a file, or does not come to an end: tried in another process."""
    code = "import sys; from scipy.io import loadmat; loadmat(sys.argv[1])"
    command = [sys.executable, "-c", code, str(path)]
    try:
        return subprocess.run(command, capture_output=True, timeout=300, check=False).returncode < 0
    except subprocess.TimeoutExpired:
        return True


def mat_value(data: dict[str, object], key: str | None, path: Path, what: str) -> object:
    """The value of a dotted key in a MAT file; without a key, its only variable."""
    names = [name for name in data if not name.startswith("__")]
    if not names:
        raise InputError(f"{what}: {str(path)!r} holds no variable; save the array in one")
    if key is None:
        if len(names) != 1:
            raise InputError(
                f'{what}: {str(path)!r} holds {", ".join(names)}; say which with key = "{names[0]}"'
            )
        return data[names[0]]
    value: object = data
    for step in key.split("."):
        fields = names if value is data else getattr(value, "_fieldnames", [])
        if step not in fields:
            raise InputError(
                f"{what}: {str(path)!r} holds no {key!r}; there is {', '.join(fields) or 'no more'}"
            )
        value = data[step] if value is data else getattr(value, step)
    return value


def fill_holes(inverse_depth: np.ndarray, method: str, what: str) -> np.ndarray:
    """Inverse depth without NaN, same shape.

    `background`: the farther of the nearest known pixels to the left and right, because what a stereo pair
    could not match lies mostly behind an edge; rows of holes alone take the nearest known one's. `nearest`:
    the nearest known pixel's. `refuse`: raises InputError if there is a hole.
    """
    holes = ~np.isfinite(inverse_depth)
    if not holes.any():
        return inverse_depth
    if method == "refuse":
        raise InputError(
            f'{what}: {holes.mean():.1%} of its pixels are holes; fill them, or choose holes = "background"'
        )
    from scipy.ndimage import distance_transform_edt

    nearest = distance_transform_edt(holes, return_distances=False, return_indices=True)
    filled = inverse_depth[tuple(np.asarray(nearest))]
    if method == "nearest":
        return filled
    left = _carried(inverse_depth)
    right = _carried(inverse_depth[:, ::-1])[:, ::-1]
    beside = np.fmin(left, right)  # the farther one; a missing side counts for nothing
    return np.where(holes & np.isfinite(beside), beside, filled)


def _carried(values: np.ndarray) -> np.ndarray:
    """Each row's last known value carried on to the right; NaN before the first."""
    columns = np.arange(values.shape[1])
    last = np.maximum.accumulate(np.where(np.isfinite(values), columns, -1), axis=1)
    carried = np.take_along_axis(values, np.maximum(last, 0), axis=1)
    return np.where(last >= 0, carried, np.nan)
