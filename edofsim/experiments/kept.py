"""What an experiment has finished, one line of JSON each, so that an interrupted one goes on from there."""

from __future__ import annotations

import functools
import hashlib
import json
from collections.abc import Mapping
from pathlib import Path

from ..core.files import append_line
from ..core.json_values import Json
from ..record import versions

PACKAGE = Path(__file__).parents[1]


class Kept:
    """Findings by key in a file of lines. A key says everything that decides a finding (see `key_of`).

    A line that an interruption cut short is passed over."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._found: dict[str, Json] = {}
        if path.is_file():
            text = path.read_text(encoding="utf-8", errors="replace")
            for line in text.splitlines():
                try:
                    entry = json.loads(line)
                    self._found[entry["key"]] = entry["found"]
                except (ValueError, KeyError, TypeError):
                    continue

    def __len__(self) -> int:
        return len(self._found)

    def get(self, key: str) -> Json | None:
        """The finding of a key, or None."""
        return self._found.get(key)

    def put(self, key: str, found: Mapping[str, object]) -> None:
        """Keep a finding, on disk before this returns. Raises what `core.files.whole` raises."""
        self._found[key] = dict(found)
        append_line(self._path, json.dumps({"key": key, "found": self._found[key]}))


def key_of(**parts: object) -> str:
    """A key of everything that decides a finding: JSON values by name, and the code that makes it."""
    said = {"code": code_of(PACKAGE), "versions": _versions(), **parts}
    return hashlib.sha256(json.dumps(said, sort_keys=True, default=str).encode()).hexdigest()[:24]


@functools.cache
def code_of(folder: Path) -> str:
    """SHA-256 of all Python sources in a folder: another line of code is another version."""
    digest = hashlib.sha256()
    for path in sorted(folder.rglob("*.py")):
        digest.update(f"{path.relative_to(folder)}\0".encode() + path.read_bytes() + b"\0")
    return digest.hexdigest()


_versions = functools.cache(versions)
