"""What is checked of a file before its numbers are read: that it is there, and that it is not too large."""

from __future__ import annotations

import math
from pathlib import Path

from ..errors import InputError

MAX_PIXELS = 1 << 26
"""Of one picture, 8192 x 8192: as linear light in three channels these take 1.5 GiB."""
MAX_NUMBERS = 1 << 28
"""Of a depth map or spectral cube."""


def existing(path: Path, what: str) -> Path:
    """The path of a file that is there. Raises InputError."""
    if path.is_dir():
        raise InputError(f"{what}: {str(path)!r} is a folder; name a file in it")
    if not path.is_file():
        raise InputError(f"{what}: the file {str(path)!r} does not exist")
    return path


def check_pixels(rows: int, columns: int, path: Path, what: str) -> None:
    """Raises InputError for a picture too large to hold, by what its file says of itself."""
    if rows * columns > MAX_PIXELS:
        raise InputError(
            f"{what}: {str(path)!r} has {columns} x {rows} pixels, too many to read (at most "
            f"{MAX_PIXELS >> 20} x 2^20); scale it down or cut it"
        )


def check_numbers(shape: tuple[int, ...], path: Path, what: str) -> None:
    """Raises InputError for an array too large to compute with."""
    count = math.prod(shape)
    if count > MAX_NUMBERS:
        size = " x ".join(map(str, shape))
        raise InputError(
            f"{what}: {str(path)!r} holds {size} numbers ({count * 8 / 2**30:.1f} GiB in double precision), "
            f"more than {MAX_NUMBERS >> 20} x 2^20; cut it to the part that you need"
        )
