"""Rendered views on disk: found by what decides their pixels, checked whenever they are read.

An entry is two files: `NAME-KEY.exr`, the view, and `NAME-KEY.json` with its checksum and what is known of
its making. The JSON is written first, and both are written under another name, synced and renamed: an EXR
that is there is complete, whatever was killed when. An entry whose checksum is wrong is set aside as
`*.damaged-N` and rendered again. `NAME-KEY.partial` holds the sums of interrupted work and `NAME-KEY.lock`
keeps two processes from rendering one view at the same time.
"""

from __future__ import annotations

import hashlib
import json
import os
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from filelock import FileLock, Timeout

from ..core.files import sync, whole
from ..core.json_values import Json
from ..core.store import user_folder
from .exr import read_view, write_view
from .fragments import Fragments

OPTION = "--cache or EDOFSIM_CACHE"
ADVICE = "choose another folder with --cache, and start again: finished work is kept"

SHOWN = 24
"""Digits of the key in file names; the JSON has all 64."""


def default_folder() -> Path:
    """`EDOFSIM_CACHE` if that is set, `render_cache/` in a checkout, else a folder in the user's cache."""
    named = os.environ.get("EDOFSIM_CACHE")
    if named:
        return Path(named)
    checkout = Path(__file__).resolve().parents[2]
    if (checkout / "render_cache").is_dir() and (checkout / "pyproject.toml").is_file():
        return checkout / "render_cache"
    return user_folder() / "views"


@dataclass(frozen=True)
class Place:
    """Where the view of a key lives in a folder."""

    folder: Path
    name: str
    key: str

    def file(self, suffix: str) -> Path:
        """`NAME-KEY` with a suffix: exr, json, partial, lock."""
        return self.folder / f"{self.name}-{self.key[:SHOWN]}.{suffix}"


@dataclass(frozen=True)
class Entry:
    """A complete entry.

    bytes: of both files.
    used: seconds since 1970, of the last reading or writing.
    """

    path: Path
    key: str
    scene: str
    bytes: int
    used: float
    record: Json


@dataclass(frozen=True)
class Verified:
    """Outcome of `verify`: how many entries are as written, and which files were set aside."""

    good: int
    damaged: tuple[Path, ...]


@dataclass(frozen=True)
class Pruned:
    """Outcome of `prune`."""

    files: int
    bytes: int


def load(place: Place, *, aside: bool) -> tuple[Fragments | None, str]:
    """The view of a key, or None, and a message if the entry is damaged.

    aside: set a damaged entry aside; only for who holds the key's lock.
    """
    path = place.file("exr")
    if not path.is_file():
        return None, ""
    reason = _damage(path, place.key)
    if not reason:
        try:
            view = read_view(path)
        except ValueError as error:
            reason = str(error)
        else:
            with suppress(OSError):
                os.utime(path)
            return view, ""
    kept = f"; it is kept as {set_aside(path).name} and rendered again" if aside else ""
    return None, f"{path.name} is damaged ({reason}){kept}"


def _damage(path: Path, key: str | None = None) -> str:
    """What is wrong with an entry; empty if nothing is."""
    try:
        record = json.loads(path.with_suffix(".json").read_text(encoding="utf-8"))
        expected = record["sha256"]
        stored_key = record["key"]
    except FileNotFoundError:
        return "no checksum next to it"
    except (OSError, ValueError, KeyError, TypeError):
        return "the checksum next to it is unreadable"
    if key is not None and stored_key != key:
        return "it belongs to another recipe"
    try:
        return "" if _checksum(path) == expected else "its checksum differs"
    except OSError as error:
        return f"it cannot be read: {error.strerror}"


def _checksum(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def set_aside(path: Path) -> Path:
    """Rename an entry's files to `*.damaged-N`, N the first that is free; returns the EXR's new name."""
    number = 1
    while any(path.with_suffix(f"{suffix}.damaged-{number}").exists() for suffix in (".exr", ".json")):
        number += 1
    aside = path.with_suffix(f".exr.damaged-{number}")
    for suffix in (".exr", ".json"):
        with suppress(FileNotFoundError):
            os.replace(path.with_suffix(suffix), path.with_suffix(f"{suffix}.damaged-{number}"))
    return aside


def store(place: Place, view: Fragments, recipe: Json, record: Json) -> Callable[[], Fragments]:
    """Write an entry and return what gives the view as it is read: the same now and from the cache.

    Raises what `core.files.whole` raises.
    """
    final = place.file("exr")
    with whole(final, advice=ADVICE) as view_file:
        stored = write_view(view_file, view, recipe)
        sync(view_file)
        content = {
            "key": place.key,
            "scene": place.name,
            "sha256": _checksum(view_file),
            "bytes": view_file.stat().st_size,
            "written": time.time(),
            **record,
        }
        with whole(place.file("json"), advice=ADVICE) as record_file:
            record_file.write_text(json.dumps(content, indent=1, sort_keys=True), encoding="utf-8")
    sync(place.folder)
    return stored


@contextmanager
def locked(place: Place, waiting: Callable[[], None] | None = None) -> Generator[None]:
    """Hold a key; calls `waiting()` once if another process holds it. A process that dies lets go."""
    lock = FileLock(str(place.file("lock")))
    try:
        lock.acquire(timeout=0)
    except Timeout:
        if waiting:
            waiting()
        lock.acquire()
    try:
        yield
    finally:
        lock.release()


def ls(folder: Path) -> list[Entry]:
    """The complete entries of a folder, last used first. Checksums are not read: see `verify`."""
    entries = []
    for path in sorted(folder.glob("*.exr")):
        try:
            record = json.loads(path.with_suffix(".json").read_text(encoding="utf-8"))
            stat = path.stat()
            size = stat.st_size + path.with_suffix(".json").stat().st_size
            entries.append(Entry(path, record["key"], record["scene"], size, stat.st_mtime, record))
        except (OSError, ValueError, KeyError, TypeError):
            continue
    return sorted(entries, key=lambda entry: -entry.used)


def verify(folder: Path) -> Verified:
    """Read every entry and set aside what is not as it was written."""
    good = 0
    damaged: list[Path] = []
    for path in sorted(folder.glob("*.exr")):
        if _damage(path):
            damaged.append(set_aside(path))
        else:
            good += 1
    return Verified(good, tuple(damaged))


def prune(folder: Path, older_than_days: float = 0.0) -> Pruned:
    """Remove entries that were not used for this many days, and what is left over of any age: damaged files,
    interrupted work, locks and temporary files that nobody holds."""
    limit = time.time() - older_than_days * 86400
    files = freed = 0
    entries = {entry.path for entry in ls(folder)}
    old = {path for path in entries if path.stat().st_mtime <= limit}
    for path in sorted(folder.iterdir()) if folder.is_dir() else []:
        entry = path.with_suffix(".exr")
        leftover = ".damaged-" in path.name or path.suffix in (".partial", ".lock", ".tmp")
        if not path.is_file() or not (entry in old or leftover) or _held(path):
            continue
        with suppress(OSError):
            size = path.stat().st_size
            path.unlink()
            files, freed = files + 1, freed + size
    return Pruned(files, freed)


def _held(path: Path) -> bool:
    """Whether a process works on the key that a file belongs to."""
    lock = path.with_suffix(".lock")
    if not lock.exists():
        return False
    try:
        with FileLock(str(lock), timeout=0):
            return False
    except Timeout:
        return True
