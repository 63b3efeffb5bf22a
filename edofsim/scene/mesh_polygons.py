"""Faces of more than three corners: trimesh cuts them from their first corner, as if they were convex."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

import numpy as np

from ..core.json_values import Json


def not_convex(vertices: np.ndarray, polygons: Iterable[Sequence[int]]) -> int:
    """How many polygons, by the numbers of their corners, are not convex.

    vertices: [vertex, 3].
    """
    by_count: dict[int, list[Sequence[int]]] = {}
    for corners in polygons:
        if len(corners) > 3:
            by_count.setdefault(len(corners), []).append(corners)
    vertices = np.where(np.isfinite(vertices), vertices, 0)
    found = 0
    for same in by_count.values():
        index = np.array(same, np.int64)
        index = index[((index >= 0) & (index < len(vertices))).all(axis=1)]
        corners = vertices[index]
        sides = np.roll(corners, -1, axis=1) - corners
        turns = np.cross(np.roll(sides, 1, axis=1), sides)
        normal = turns.sum(axis=1, keepdims=True)
        size = (sides**2).sum(axis=(1, 2), keepdims=True)
        found += int(((turns * normal).sum(-1, keepdims=True) < -1e-3 * size**2).any(axis=1).sum())
    return found


def not_convex_of_obj(content: bytes) -> int:
    """Of the text of an OBJ file, whose faces count their corners from the front."""
    faces = re.finditer(rb"(?m)^[ \t]*f((?:[ \t]+\d{1,9}(?:/[-\d/]*)?){4,})[ \t\r]*$", content)
    polygons = [[int(word.split(b"/")[0]) - 1 for word in face[1].split()] for face in faces]
    lines = re.findall(rb"(?m)^[ \t]*v[ \t]+(\S+)[ \t]+(\S+)[ \t]+(\S+)", content) if polygons else []
    return _counted(lines, polygons)


def read_off(content: bytes) -> tuple[bytes, int]:
    """The text of an OFF file, faces of more than four corners cut into triangles, as trimesh cannot, and how
    many polygons are not convex."""
    lines = [line.split(b"#")[0].split() for line in content.splitlines()]
    words = [line for line in lines if line and line != [b"OFF"]]
    if words and words[0][0] == b"OFF":
        words[0] = words[0][1:]
    try:
        count, faces = int(words[0][0]), int(words[0][1])
        vertices, listed = words[1 : 1 + count], words[1 + count : 1 + count + faces]
        polygons = [[int(word) for word in line[1 : 1 + int(line[0])]] for line in listed]
    except (IndexError, ValueError):
        return content, 0  # trimesh says what is wrong
    bent = _counted([line[:3] for line in vertices], polygons)
    if max((len(each) for each in polygons), default=0) <= 4:
        return content, bent
    fans = [(3, face[0], *pair) for face in polygons for pair in zip(face[1:-1], face[2:], strict=True)]
    body = [*(b" ".join(line[:3]) for line in vertices), *(b"%d %d %d %d" % fan for fan in fans)]
    return b"\n".join([b"OFF", b"%d %d 0" % (count, len(fans)), *body]) + b"\n", bent


def not_convex_of_ply(raw: Json) -> int:
    """Of what trimesh keeps of a PLY file, `_ply_raw` of its metadata."""
    try:
        vertex, face = raw["vertex"]["data"], raw["face"]["data"]
        name = next(name for name in ("vertex_indices", "vertex_index") if name in raw["face"]["properties"])
        listed = face[name]
        if getattr(listed.dtype, "names", None):  # binary: how many corners, and which
            listed = listed[listed.dtype.names[-1]]
        polygons = [np.ravel(corners).tolist() for corners in listed]
        lines = np.stack([np.asarray(vertex[axis], float).ravel() for axis in "xyz"], axis=1)
    except (KeyError, IndexError, StopIteration, ValueError, TypeError, AttributeError):
        return 0
    return not_convex(lines, polygons)


def _counted(lines: Sequence[Sequence[bytes]], polygons: Sequence[Sequence[int]]) -> int:
    try:
        return not_convex(np.array(lines, float).reshape(-1, 3), polygons)
    except ValueError:
        return 0  # trimesh says what is wrong
