"""What was computed before, by the key of all that decides it: in memory, and on request as files.

A file that is damaged counts as none, and one that cannot be written is a warning: work goes on without it.
"""

from __future__ import annotations

import logging
import os
import threading
from collections import OrderedDict
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Generic, TypeVar

import platformdirs
from safetensors import SafetensorError

from ..errors import EdofsimError
from .files import whole

V = TypeVar("V")
LOG = logging.getLogger(__name__)
DAMAGED = (OSError, ValueError, LookupError, TypeError, AttributeError, SafetensorError)
"""What reading a file raises that is not there, cut short, or of another layout."""


def user_folder() -> Path:
    """Where this user's caches are."""
    return Path(platformdirs.user_cache_dir("edofsim", appauthor=False))


def found(path: Path, read: Callable[[Path], V]) -> V | None:
    """What a file holds; None if it is not there or damaged: if `read` raises one of `DAMAGED`."""
    try:
        return read(path)
    except DAMAGED:
        return None


def keep(path: Path, write: Callable[[Path], object]) -> None:
    """Write a file, complete or not there. Where that cannot be, say so and go on."""
    try:
        with whole(path) as temporary:
            write(temporary)
    except EdofsimError as error:
        LOG.warning("not kept for next time: %s", error)


class Store(Generic[V]):
    """Values by key.

    name: of a key's file, such as `bank-{}.safetensors`.
    read, write: a value and a path.

    size: bytes of a value; those used longest ago leave the memory where all together exceed `memory_bytes`,
        and with 0 nothing stays there.
    most_files: those used longest ago leave the folder where there are more.
    """

    def __init__(
        self,
        name: str,
        read: Callable[[Path], V],
        write: Callable[[V, Path], object],
        *,
        size: Callable[[V], int] = lambda value: 1,
        memory_bytes: int = 0,
        most_files: int | None = None,
    ) -> None:
        self.memory_bytes = memory_bytes
        self._name, self._read, self._write = name, read, write
        self._size, self._most_files = size, most_files
        self._memory: OrderedDict[str, V] = OrderedDict()
        self._lock = threading.Lock()

    def find(self, key: str, folder: Path | None) -> V | None:
        """The value of a key from memory or the folder, or None."""
        value = self._memory.get(key)
        if value is None and folder is not None:
            path = self._file(key, folder)
            value = found(path, self._read)
            if value is not None and self._most_files is not None:
                with suppress(OSError):  # a folder that can only be read
                    os.utime(path)
        if value is not None:
            self._remember(key, value)
        return value

    def keep(self, key: str, value: V, folder: Path | None) -> None:
        """Keep a value in memory, and in the folder if there is one."""
        self._remember(key, value)
        if folder is not None:
            keep(self._file(key, folder), lambda path: self._write(value, path))
            if self._most_files is not None:
                self._thin(folder, self._most_files)

    def forget(self) -> None:
        """Empty the memory; files stay."""
        with self._lock:
            self._memory.clear()

    def _file(self, key: str, folder: Path) -> Path:
        return folder / self._name.format(key)

    def _remember(self, key: str, value: V) -> None:
        with self._lock:
            self._memory[key] = value
            self._memory.move_to_end(key)
            total = sum(map(self._size, self._memory.values()))
            while total > self.memory_bytes:
                total -= self._size(self._memory.popitem(last=False)[1])

    def _thin(self, folder: Path, most: int) -> None:
        with suppress(OSError):  # another process thins it, too
            paths = sorted(folder.glob(self._name.format("*")), key=lambda path: path.stat().st_mtime)
            for path in paths[: max(0, len(paths) - most)]:
                path.unlink(missing_ok=True)
