"""Tables out of colour-science, kept in the user's folder: importing the package takes most of a second."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from functools import lru_cache
from importlib import metadata
from pathlib import Path
from urllib.parse import quote

import numpy as np
from numpy.typing import ArrayLike

from .store import Store, user_folder

version = lru_cache(metadata.version)  # which reads a file each time


def _read(path: Path) -> dict[str, np.ndarray]:
    kept = json.loads(path.read_text(encoding="utf-8"))
    return {name: np.array(rows, float, ndmin=2) for name, rows in kept.items()}


def _write(tables: Mapping[str, np.ndarray], path: Path) -> None:
    path.write_text(json.dumps({name: rows.tolist() for name, rows in tables.items()}), encoding="utf-8")


_KEPT = Store("{}.json", _read, _write, memory_bytes=256, most_files=256)  # each counts as one byte


def kept_tables(name: str, make: Callable[[], Mapping[str, ArrayLike]]) -> Mapping[str, np.ndarray]:
    """Numbers that `make` takes from colour-science: float64 [row, column] by name, in its order.

    make: gives arrays [row, column] by name.

    Those of a `name` are kept, and made anew for another version of colour-science; what `make` raises is
    not kept. All names together are at most 256; those used longest ago leave.
    """
    key, folder = quote(f"{name} {version('colour-science')}", safe=" "), user_folder() / "tables"
    tables = _KEPT.find(key, folder)
    if tables is None:
        tables = {entry: np.array(rows, float, ndmin=2) for entry, rows in make().items()}
        _KEPT.keep(key, tables, folder)
    return tables


def forget() -> None:
    """Empty the memory; files stay."""
    _KEPT.forget()
