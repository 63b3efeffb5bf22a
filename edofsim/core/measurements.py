"""Measurements in files: the one reader for depths, heights and whatever else is no colour.

NaN and infinity are legal in every format alike. Objects that a file holds are never unpickled.
"""

from __future__ import annotations

import csv
import functools
import io
import json
import os
import re
import select
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from ..errors import InputError, first_line
from . import hdf5
from .decoded import decoded
from .high_range import read_pfm
from .images import read_exr
from .json_values import Json
from .limits import check_numbers, check_pixels, existing
from .shipped import installed

SKIMAGE = "skimage:"
"""Prefix of pictures and disparities that come inside scikit-image."""
TEXTS = (".csv", ".txt", ".dat", ".asc", ".tsv")
MAX_TEXT_BYTES = 1 << 28
READ_S = 300
READER = Path(__file__).with_name("mat_reader.py")
DEPTH_CHANNELS = ("z", "depth", "distance", "disparity", "v")


def read_numbers(name: str, key: str | None, base: Path, what: str) -> np.ndarray:
    """The array of a file, by its suffix: NPY, NPZ, MAT, HDF5, EXR, PFM, DPT, CSV and text, TIFF, PNG and
    other pictures; or `skimage:NAME`.

    key: array of an NPZ, MAT or HDF5 (dots go into its structures), or channel of an EXR.

    Raises InputError.
    """
    if name.startswith(SKIMAGE):
        return packaged(name.removeprefix(SKIMAGE), what)
    path = Path(base) / name
    existing(path, what)
    suffix = path.suffix.lower()
    if suffix in hdf5.SUFFIXES:
        return one_array(hdf5.read_hdf5(path, key, what), key, path, what)
    readers = {".npy": _numpy, ".npz": _numpy, ".mat": read_mat, ".exr": _exr}
    if suffix in readers:
        return readers[suffix](path, key, what)
    if key is not None:
        raise InputError(
            f"{what}: {str(path)!r} has no arrays or channels with names; leave out key = {key!r}"
        )
    if suffix == ".pfm":
        return read_pfm(path, what)
    if suffix == ".dpt":
        return read_sintel(path, what)
    if suffix in TEXTS:
        return read_text(path, what)
    return _single(decoded(path, what, measured=True).values, path, what)


def one_array(found: dict[str, np.ndarray], key: str | None, path: Path, what: str) -> np.ndarray:
    """The array that was asked for, of `hdf5.read_hdf5`.

    found: arrays of any shape [...] by name.

    Raises InputError where there is none.
    """
    if not found:
        raise InputError(f"{what}: {str(path)!r} holds no array of numbers")
    return _numbers(next(iter(found.values())), path, what)


def _single(values: np.ndarray, path: Path, what: str) -> np.ndarray:
    """One channel of a picture whose colours are equal. Raises InputError for real colours."""
    if values.ndim == 2:
        return values
    colours = values[..., : values.shape[2] - (values.shape[2] in (2, 4))]
    first = colours[..., 0]
    if colours.shape[2] > 1 and not all(
        np.array_equal(first, colours[..., i], equal_nan=first.dtype.kind == "f")
        for i in range(1, colours.shape[2])
    ):
        raise InputError(
            f"{what}: {str(path)!r} is a picture in colours; a measurement has one number a pixel: take the "
            "file with the numbers, not a drawing of them"
        )
    return first


def read_text(path: Path, what: str) -> np.ndarray:
    """Rows of numbers of a text file, float64 [y, x], separated by commas, semicolons, tabs or blanks.

    Lines that begin with `#` or `%`, and one line of words at the top, are left out; an empty field is NaN.
    Raises InputError that names the line.
    """
    existing(path, what)
    if path.stat().st_size > MAX_TEXT_BYTES:
        raise InputError(f"{what}: {str(path)!r} is a text of more than {MAX_TEXT_BYTES >> 20} MiB; use .npy")
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise InputError(f"{what}: {str(path)!r} is not text") from None
    numbered = [(n, line) for n, line in enumerate(text.splitlines(), 1) if line.strip()]
    numbered = [(n, line) for n, line in numbered if line.strip()[0] not in "#%"]
    rows: list[list[float]] = []
    for number, line in numbered:
        fields = _fields(line)
        try:
            rows.append([float(field) if field else np.nan for field in fields])
        except ValueError:
            if not rows and number == numbered[0][0]:
                continue
            raise InputError(f"{what}: {str(path)!r}, line {number}: is no row of numbers") from None
        if len(rows[-1]) != len(rows[0]):
            raise InputError(
                f"{what}: {str(path)!r}, line {number}: has {len(rows[-1])} numbers, the first row "
                f"{len(rows[0])}"
            )
    if not rows:
        raise InputError(f"{what}: {str(path)!r} holds no numbers")
    return np.array(rows, float)


def _fields(line: str) -> list[str]:
    separator = next((mark for mark in (";", "\t", ",") if mark in line), None)
    if separator is None:
        return line.split()
    fields = [field.strip() for field in next(csv.reader(io.StringIO(line), delimiter=separator))]
    return [re.sub(r"(?<=\d),(?=\d)", ".", field) for field in fields] if separator != "," else fields


def read_sintel(path: Path, what: str) -> np.ndarray:
    """A depth map of MPI Sintel (D. J. Butler et al., ECCV 2012), float32 [y, x] in metres.
    Raises InputError for a file that is damaged or no .dpt."""
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
    """A picture or disparity map that comes inside scikit-image, as it is stored."""
    path = packaged_file(name, what)
    return _numpy(path, None, what) if path.suffix == ".npz" else decoded(path, what).values


def packaged_file(name: str, what: str) -> Path:
    """The file of a picture or disparity map that comes inside scikit-image. Raises InputError."""
    folder = installed("skimage") / "data"
    for suffix in (".png", ".jpg", ".npz"):
        path = folder / f"{name}{suffix}"
        if path.parent == folder and path.is_file():
            return path
    raise InputError(f"{what}: scikit-image brings no {name!r} in its package")


def _numpy(path: Path, key: str | None, what: str) -> np.ndarray:
    try:
        loaded = np.load(path, mmap_mode="r", allow_pickle=False)
        if isinstance(loaded, np.ndarray):
            if key is not None:
                raise InputError(f"{what}: {str(path)!r} is one array; leave out key = {key!r}")
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
        reason = first_line(error)
        if "pickle" in reason.lower():
            reason = "it is no file of NumPy's, or holds Python objects; save numbers with numpy.save"
        raise InputError(f"{what}: {str(path)!r} cannot be read as numbers: {reason}") from error


def _numbers(array: np.ndarray, path: Path, what: str) -> np.ndarray:
    if array.size == 0:
        raise InputError(f"{what}: {str(path)!r} holds an array without numbers, of shape {array.shape}")
    if array.dtype.kind not in "buif":
        raise InputError(f"{what}: {str(path)!r} holds {array.dtype}, not real numbers")
    check_numbers(array.shape, path, what)
    return np.array(array, array.dtype.newbyteorder("="))


def _exr(path: Path, key: str | None, what: str) -> np.ndarray:
    """A channel of an OpenEXR file: `key`, else Z, the only one, the only one that is called a depth, or R
    where R, G and B are equal."""
    channels = read_exr(path, what)
    names = list(channels)
    if key is not None:
        if key not in channels:
            raise InputError(f"{what}: {str(path)!r} has no channel {key!r}; it has {', '.join(names[:24])}")
        return channels[key]
    depths = [n for n in names if n.lower().replace(".v", "").rpartition(".")[2] in DEPTH_CHANNELS]
    colours = [channels[c] for c in "RGB" if c in channels]
    if "Z" in channels:
        return channels["Z"]
    if len(names) == 1 or len(depths) == 1:
        return channels[(depths or names)[0]]
    grey = len(colours) == 3 and set(names) <= set("RGBA")
    if grey and all(np.array_equal(colours[0], plane, equal_nan=True) for plane in colours[1:]):
        return colours[0]
    raise InputError(
        f"{what}: {str(path)!r} has no channel 'Z'; it has {', '.join(names[:24])}; say which with "
        f'key = "{(depths or names)[0]}"'
    )


def read_mat(path: Path, key: str | None, what: str) -> np.ndarray:
    """An array of a MAT file; dots in `key` go into its structures."""
    existing(path, what)
    if hdf5.is_hdf5(path):
        return one_array(hdf5.read_hdf5(path, key, what), key, path, what)
    return _numbers(np.asarray(mat_value(load_mat(path, what), key, path, what)), path, what)


def load_mat(path: Path, what: str) -> dict[str, object]:
    """All of a MAT file up to version 7; structures become objects with attributes.
    Raises InputError for a file that cannot be read."""
    existing(path, what)
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / "read.npz"
        said = _read_apart(path, target)
        if said is None:
            raise InputError(f"{what}: {str(path)!r} is a damaged MAT file; save it again, or use .npz")
        if said:
            raise InputError(
                f"{what}: {str(path)!r} cannot be read as a MAT file: {first_line(ValueError(said))}"
            )
        with np.load(target, allow_pickle=False) as arrays:
            tree = json.loads(str(arrays["tree"]))
            return {name: _value(each, arrays) for name, each in tree.items()}


def _value(said: Json | str, arrays: Mapping[str, np.ndarray]) -> object:
    """What `mat_reader.flat` made JSON of."""
    if isinstance(said, str):
        return arrays[said]
    if "fields" not in said:
        return np.empty(said["shape"], dtype=object)
    fields = {name: _value(each, arrays) for name, each in said["fields"].items()}
    return SimpleNamespace(_fieldnames=list(fields), **fields)


def _read_apart(path: Path, target: Path) -> str | None:
    """Have another process read a MAT file, and write what it holds. Some damaged ones crash SciPy's reader,
    one time and not another, or never end. The process takes half a second to start and stays for the next
    file; a crash is the file's fault if it was the first that it read.

    Returns what is wrong, empty where nothing is; None for a crash, or no end.
    """
    reader = _reader(os.getpid())
    assert reader.stdin is not None and reader.stdout is not None
    fresh = reader.pid not in _used
    _used.add(reader.pid)
    with suppress(BrokenPipeError):  # it was ended in the meantime: another one reads
        reader.stdin.write(json.dumps([str(path.absolute()), str(target)]) + "\n")
        reader.stdin.flush()
        if select.select([reader.stdout], [], [], READ_S)[0] and (answer := reader.stdout.readline()):
            return json.loads(answer)
    reader.kill()
    reader.wait()
    _used.discard(reader.pid)
    _reader.cache_clear()
    return None if fresh else _read_apart(path, target)


_used: set[int] = set()
"""Processes that have read a file."""


@functools.cache
def _reader(process: int) -> subprocess.Popen[str]:
    """What reads MAT files for a process: one that was forked off it has another."""
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL}
    return subprocess.Popen([sys.executable, "-P", str(READER)], text=True, **pipes)


def mat_value(data: dict[str, object], key: str | None, path: Path, what: str) -> object:
    """The value of a dotted key in a MAT file; without a key, its only variable.
    Raises InputError for a variable that is not there, and for no key where there are several."""
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
