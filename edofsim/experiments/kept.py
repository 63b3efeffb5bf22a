"""What an experiment has finished, one line of JSON each, so that an interrupted one goes on from there."""

from __future__ import annotations

import functools
import hashlib
import json
from collections.abc import Mapping
from pathlib import Path

from ..core.files import append_line
from ..core.json_values import Json
from ..core.sources import PACKAGE, code_of
from ..record import versions


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


_versions = functools.cache(versions)
