"""The code that made what is kept: another line of it is another key."""

from __future__ import annotations

import functools
import hashlib
from pathlib import Path

PACKAGE = Path(__file__).parents[1]


@functools.cache
def code_of(folder: Path) -> str:
    """SHA-256 of all Python sources in a folder: another line of code is another version."""
    digest = hashlib.sha256()
    for path in sorted(folder.rglob("*.py")):
        digest.update(f"{path.relative_to(folder)}\0".encode() + path.read_bytes() + b"\0")
    return digest.hexdigest()


def code_of_rooms(*rooms: str) -> list[str]:
    """The same of folders of this package, such as `optics`, for keys of what they make."""
    return [code_of(PACKAGE / room) for room in rooms]
