"""The text of OBJ files, as far as trimesh reads it otherwise than Wavefront's specification."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np


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


def not_convex(content: bytes) -> int:
    """How many of the faces have more than three corners and are not convex. All are cut into triangles from
    their first corner, which is wrong for some of those. The faces count their corners from the front."""
    by_count: dict[int, list[list[int]]] = {}
    for match in re.finditer(rb"(?m)^[ \t]*f((?:[ \t]+\d{1,9}(?:/[-\d/]*)?){4,})[ \t\r]*$", content):
        corners = [int(word.split(b"/")[0]) for word in match[1].split()]
        by_count.setdefault(len(corners), []).append(corners)
    if not by_count:
        return 0
    lines = re.findall(rb"(?m)^[ \t]*v[ \t]+(\S+)[ \t]+(\S+)[ \t]+(\S+)", content)
    try:
        vertices = np.array(lines, float).reshape(-1, 3)
    except ValueError:
        return 0  # trimesh says what is wrong
    vertices = np.where(np.isfinite(vertices), vertices, 0)
    found = 0
    for polygons in by_count.values():
        index = np.array(polygons) - 1
        index = index[((index >= 0) & (index < len(vertices))).all(axis=1)]
        corners = vertices[index]
        sides = np.roll(corners, -1, axis=1) - corners
        turns = np.cross(np.roll(sides, 1, axis=1), sides)
        normal = turns.sum(axis=1, keepdims=True)
        size = (sides**2).sum(axis=(1, 2), keepdims=True)
        found += int(((turns * normal).sum(-1, keepdims=True) < -1e-3 * size**2).any(axis=1).sum())
    return found
