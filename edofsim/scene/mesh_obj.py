"""The text of OBJ files, as far as trimesh reads it otherwise than Wavefront's specification."""

from __future__ import annotations

import re
from collections.abc import Sequence


def absolute_indices(content: bytes) -> bytes:
    """A file whose faces count their corners from the front. A negative number counts back from the last
    corner so far (Wavefront's specification of OBJ), where trimesh counts from the end of the file."""
    if not re.search(rb"(?m)^\s*f\s.*-\d", content):
        return content
    counts = {b"v": 0, b"vt": 0, b"vn": 0}
    lines = content.replace(b"\\\r\n", b" ").replace(b"\\\n", b" ").splitlines()
    for number, line in enumerate(lines):
        words = line.split()
        if words and words[0] in counts:
            counts[words[0]] += 1
        elif words and words[0] == b"f":
            lines[number] = b" ".join(
                [b"f", *(_absolute(corner, list(counts.values())) for corner in words[1:])]
            )
    return b"\n".join(lines) + b"\n"


def _absolute(corner: bytes, counts: Sequence[int]) -> bytes:
    """A corner of a face (vertex/texture/normal); counts: of each so far."""
    parts = corner.split(b"/")
    for place, (part, count) in enumerate(zip(parts, counts, strict=False)):
        if re.fullmatch(rb"-\d{1,9}", part):
            parts[place] = b"%d" % (count + 1 + int(part))
    return b"/".join(parts)
