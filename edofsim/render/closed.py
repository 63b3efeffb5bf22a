"""Whether a mesh encloses a volume."""

from __future__ import annotations

import hashlib

import numpy as np

from ..scene.model import TriangleMesh


def is_closed(mesh: TriangleMesh) -> bool:
    """Whether every edge has two faces, once vertices at one place are counted as one: then a back face is
    the inside of something, and never seen from outside."""
    if len(mesh.faces) < 4:
        return False
    vertices = np.asarray(mesh.vertices, np.float32) + np.float32(0)  # one zero, not two
    faces = np.ascontiguousarray(mesh.faces, np.uint32)
    key = hashlib.sha1(faces.tobytes()).digest()
    if key in _closed and _met_alike(vertices, _closed[key][0]):
        return _closed[key][1]
    place = _places(vertices)
    corners = place[faces.astype(np.int64)]
    ends = np.sort(np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]]), axis=1)
    edges = np.sort((ends[:, 0] * len(place) + ends[:, 1])[ends[:, 0] != ends[:, 1]])
    starts = np.flatnonzero(np.diff(edges, prepend=-1))
    found = bool((np.diff(starts, append=len(edges)) == 2).all())
    _, first = np.unique(place, return_index=True)
    if len(_closed) >= SHAPES:
        _closed.pop(next(iter(_closed)))
    _closed[key] = (first[place], found)
    return found


SHAPES = 256
"""Shapes whose answer is remembered: many objects are a few shapes at many places."""
_closed: dict[bytes, tuple[np.ndarray, bool]] = {}


def _places(vertices: np.ndarray) -> np.ndarray:
    """A number for each vertex, int64, the same where they coincide."""
    place = np.zeros(len(vertices), np.int64)
    for axis in vertices.T:
        _, rank = np.unique(axis, return_inverse=True)
        _, place = np.unique(place * len(vertices) + rank, return_inverse=True)
    return place


def _met_alike(vertices: np.ndarray, first: np.ndarray) -> bool:
    """Whether just those vertices coincide that did so in another mesh of the same faces.

    first: the first vertex at each one's place there. Two places whose mixed bits are the same by chance
    count as one, so that the answer can be wrongly no, never wrongly yes."""
    if len(first) != len(vertices) or not (vertices[first] == vertices).all():
        return False
    bits = np.ascontiguousarray(vertices).view(np.uint32).astype(np.uint64)
    mixed = np.sort((bits * MIXERS).sum(axis=1, dtype=np.uint64))
    return 1 + np.count_nonzero(np.diff(mixed)) == np.count_nonzero(first == np.arange(len(first)))


MIXERS = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9], np.uint64)
