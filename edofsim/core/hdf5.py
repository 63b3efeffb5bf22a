"""HDF5 and MATLAB 7.3, by h5py. Nothing is read from outside the file: external links, external storage and
virtual datasets are refused."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..errors import InputError, first_line
from .limits import check_numbers, existing

if TYPE_CHECKING:
    import h5py

SUFFIXES = (".h5", ".hdf5", ".hdf", ".he5")
MAGIC = b"\x89HDF\r\n\x1a\n"
DEEPEST = 16
MATLAB_OWN = "#"
"""What MATLAB's own groups begin with, of cells and references."""


def is_hdf5(path: Path) -> bool:
    """Whether a file is HDF5, by its first bytes, after the 512 of MATLAB's header as well."""
    with path.open("rb") as file:
        head = file.read(512 + len(MAGIC))
    return head.startswith(MAGIC) or head[512:] == MAGIC


def read_hdf5(path: Path, key: str | None, what: str) -> dict[str, np.ndarray]:
    """Numeric arrays of an HDF5 file by name, such as `scene/depth`: the one that `key` names, dots or
    slashes between its parts, with all lists of numbers next to it; or, without a key, all that are small or
    alone.

    Arrays of MATLAB 7.3 have their axes as in MATLAB. Raises InputError for a file that is no HDF5, that
    points to another file, or that does not have `key`, and where h5py is not installed.
    """
    existing(path, what)
    try:
        import h5py
    except ImportError:
        raise InputError(
            f"{what}: {str(path)!r} is HDF5 (as MATLAB 7.3 is), which needs h5py: pip install "
            "'edofsim[cubes]'"
        ) from None
    try:
        with h5py.File(path, "r") as file:
            found = dict(_datasets(h5py, file, "", path, what))
            wanted = None if key is None else _named(key, found, path, what)
            if wanted is None:
                large = [name for name, data in found.items() if data.ndim >= 2 and min(data.shape) > 1]
                wanted = large[0] if len(large) == 1 else None
                if len(large) > 1:
                    raise InputError(
                        f"{what}: {str(path)!r} holds {', '.join(large[:12])}; say which with key = "
                        f'"{large[0]}"'
                    )
            lists = [n for n, d in found.items() if d.size == max(d.shape, default=1) and d.size < 1 << 16]
            names = dict.fromkeys([*([] if wanted is None else [wanted]), *lists])
            return {name: _array(found[name], path, what) for name in names}
    except InputError:
        raise
    except Exception as error:  # h5py raises many kinds
        raise InputError(f"{what}: {str(path)!r} cannot be read as HDF5: {first_line(error)}") from error


def _named(key: str, found: dict[str, h5py.Dataset], path: Path, what: str) -> str:
    for name in (key.strip("/"), key.replace(".", "/").strip("/")):
        if name in found:
            return name
    raise InputError(
        f"{what}: {str(path)!r} holds no {key!r}; it holds {', '.join(list(found)[:12]) or 'none'}"
    )


def _datasets(
    h5: object, group: h5py.Group, before: str, path: Path, what: str, depth: int = 0
) -> Iterator[tuple[str, h5py.Dataset]]:
    """Datasets of numbers in a group and those within. Soft links are not followed: what they name is in the
    file under its own name."""
    import h5py

    if depth > DEEPEST:
        raise InputError(f"{what}: {str(path)!r} nests its groups too deeply")
    for name in group:
        link = group.get(name, getlink=True)
        if isinstance(link, h5py.ExternalLink):
            raise InputError(
                f"{what}: {str(path)!r} links to another file ({link.filename!r}), which is not followed; "
                "put "
                "the array into the file"
            )
        if not isinstance(link, h5py.HardLink) or name.startswith(MATLAB_OWN):
            continue
        entry = group[name]
        if isinstance(entry, h5py.Group):
            yield from _datasets(h5, entry, f"{before}{name}/", path, what, depth + 1)
        elif isinstance(entry, h5py.Dataset) and entry.dtype.kind in "buif":
            if entry.external or entry.is_virtual:
                raise InputError(
                    f"{what}: {str(path)!r} keeps {before}{name} in another file, which is not followed; put "
                    "the array into the file"
                )
            yield before + name, entry


def _array(data: h5py.Dataset, path: Path, what: str) -> np.ndarray:
    check_numbers(data.shape, path, what)
    values = np.asarray(data[()])
    return values.T if "MATLAB_class" in data.attrs else values
