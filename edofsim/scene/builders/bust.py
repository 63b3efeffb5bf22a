"""A head and shoulders on a plinth, from an implicit surface that no two seeds share.

The surface is a smooth union of ellipsoids and capsules (polynomial smooth minimum of Quilez), with eye
sockets and mouth taken away, turned into triangles by marching cubes; its normals are the gradient's.
Lengths are in units of the head's height, y up, the face towards -z; the figure stands on y = 0.
"""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field
from skimage.measure import marching_cubes

from ...recipe.base import Positive, Triple
from ...recipe.placed import Placed
from ...recipe.surfaces import AnySurface, MattSurface
from .. import solids
from .context import Builder, Context, Part

Grid = np.ndarray  # float32 [x, y, z]: a distance at each grid point, or its coordinate, of one where alike

_LOW, _HIGH = np.array([-1.15, 0.0, -0.75]), np.array([1.15, 2.45, 0.75])


class Bust(Builder, Placed):
    """A head and shoulders on a round plinth, different for every seed."""

    kind: Literal["bust"]
    height_mm: Positive = 300.0
    """height with the plinth, mm"""
    detail: Annotated[int, Field(ge=24, le=256)] = 96
    """grid points across the height of the implicit surface"""
    surface: AnySurface = MattSurface(kind="matt", reflectance=0.75)
    """what it is made of"""

    def build(self, context: Context) -> list[Part]:
        """The figure about the middle of its height, smooth-shaded, its face to the camera."""

        step = (_HIGH[1] - _LOW[1]) / self.detail
        axes = [
            np.arange(low - 2 * step, high + 2.5 * step, step) for low, high in zip(_LOW, _HIGH, strict=True)
        ]
        x, y, z = np.meshgrid(*(axis.astype(np.float32) for axis in axes), indexing="ij", sparse=True)
        distance = _figure(x, y, z, context.rng("face"))
        # kept off the grid points, where marching cubes would make triangles without an area
        distance = np.where(np.abs(distance) < 0.06 * step, np.copysign(0.06 * step, distance), distance)
        spacing = (step, step, step)
        vertices, faces, normals, _ = marching_cubes(
            distance, 0.0, spacing=spacing, gradient_direction="ascent"
        )
        vertices = vertices + [axis[0] for axis in axes]
        height = np.ptp(vertices[:, 1])
        scale = self.height_mm * 1e-3 / height
        vertices = (vertices - [0, vertices[:, 1].min() + height / 2, 0]) * scale
        around = np.arctan2(vertices[:, 0], -vertices[:, 2]) / (2 * np.pi) + 0.5
        uv = np.stack([around, vertices[:, 1] / (height * scale) + 0.5], axis=1)
        length = np.linalg.norm(normals, axis=1, keepdims=True)
        normals = np.where(length > 0, normals / np.maximum(length, 1e-12), [0, 1, 0])
        shape = solids.mesh(vertices, faces, uv, normals)
        if solids.signed_volume(shape) < 0:
            shape = solids.mesh(vertices, faces[:, ::-1], uv, normals)
        return [Part("", shape, context.surface(self.surface))]


def _ellipsoid(x: Grid, y: Grid, z: Grid, centre: Triple, radii: Triple) -> Grid:
    """About the distance from an ellipsoid, negative inside."""
    p = np.sqrt(sum(((a - c) / r) ** 2 for a, c, r in zip((x, y, z), centre, radii, strict=True)))
    q = np.sqrt(sum(((a - c) / r**2) ** 2 for a, c, r in zip((x, y, z), centre, radii, strict=True)))
    return p * (p - 1) / np.maximum(q, 1e-9)


def _capsule(x: Grid, y: Grid, z: Grid, start: Triple, end: Triple, r0: float, r1: float) -> Grid:
    """About the distance from a rod from `start` to `end` whose radius goes from r0 to r1."""
    d = [after - before for before, after in zip(start, end, strict=True)]
    along = sum((p - a) * s for p, a, s in zip((x, y, z), start, d, strict=True))
    t = np.clip(along / sum(s * s for s in d), 0, 1)
    offset = [p - (a + t * s) for p, a, s in zip((x, y, z), start, d, strict=True)]
    return np.sqrt(sum(o**2 for o in offset)) - (r0 + (r1 - r0) * t)


def _join(a: Grid, b: Grid, k: float) -> Grid:
    """The union of two shapes, rounded over `k` where they meet."""
    h = np.maximum(k - np.abs(a - b), 0) / k
    return np.minimum(a, b) - h**2 * k / 4


def _carve(a: Grid, b: Grid, k: float) -> Grid:
    """The shape `a` without `b`."""
    return -_join(-a, b, k)


def _figure(x: Grid, y: Grid, z: Grid, rng: np.random.Generator) -> Grid:
    def vary(value: float, by: float = 0.06) -> float:
        return value * (1 + by * rng.uniform(-1, 1))

    head_y, face = 1.82, -0.36
    skull = _ellipsoid(x, y, z, (0, head_y + 0.1, 0.06), (vary(0.36), vary(0.42), vary(0.45)))
    jaw = _ellipsoid(x, y, z, (0, head_y - 0.22, -0.1), (vary(0.255), vary(0.32), vary(0.28)))
    d = _join(skull, jaw, 0.22)
    d = _join(d, _ellipsoid(x, y, z, (0, head_y - 0.44, -0.28), (0.11, 0.09, 0.1)), 0.12)  # chin
    brow = _capsule(x, y, z, (-0.2, head_y + 0.07, face), (0.2, head_y + 0.07, face), 0.045, 0.045)
    d = _join(d, brow, 0.1)
    for side in (-1, 1):
        cheek = _ellipsoid(x, y, z, (side * 0.2, head_y - 0.14, -0.24), (0.11, 0.1, 0.12))
        d = _join(d, cheek, 0.12)
        socket = _ellipsoid(x, y, z, (side * 0.14, head_y - 0.01, face - 0.07), (0.095, 0.06, 0.08))
        d = _carve(d, socket, 0.07)
        eye = _ellipsoid(x, y, z, (side * 0.135, head_y - 0.015, -0.325), (0.062, 0.05, 0.055))
        d = _join(d, eye, 0.015)
        ear = _ellipsoid(x, y, z, (side * 0.37, head_y - 0.03, 0.06), (0.05, 0.13, 0.085))
        d = _join(d, ear, 0.04)
        d = _carve(d, _ellipsoid(x, y, z, (side * 0.42, head_y - 0.02, 0.03), (0.035, 0.08, 0.045)), 0.03)
    tip = vary(0.56, 0.04)
    nose = _capsule(x, y, z, (0, head_y + 0.06, face - 0.03), (0, head_y - 0.16, -tip), 0.03, vary(0.055))
    d = _join(d, nose, 0.06)
    for side in (-1, 1):
        d = _join(d, _ellipsoid(x, y, z, (side * 0.055, head_y - 0.185, -0.45), (0.042, 0.035, 0.05)), 0.03)
    lips_y = head_y - 0.3
    lips = _ellipsoid(x, y, z, (0, lips_y, -0.365), (vary(0.11), 0.05, 0.06))
    d = _join(d, lips, 0.05)
    d = _carve(d, _ellipsoid(x, y, z, (0, lips_y + 0.003, -0.45), (0.12, 0.008, 0.05)), 0.02)
    hair = _ellipsoid(x, y, z, (0, head_y + 0.17, 0.13), (0.42, 0.41, 0.46))
    a, b, c = rng.uniform(0, 2 * np.pi, 3).tolist()
    curls = np.sin(17 * x + a) * np.sin(15 * y + 9 * z + b) + 0.5 * np.sin(31 * z + 12 * x + c)
    fringe = _ellipsoid(x, y, z, (0, head_y - 0.2, -0.62), (0.62, 0.56, 0.52))
    d = _join(d, _carve(hair + 0.018 * curls, fringe, 0.05), 0.02)
    neck = _capsule(x, y, z, (0, head_y - 0.25, 0.1), (0, 0.85, 0.08), 0.21, 0.27)
    d = _join(d, neck, 0.08)
    chest = _ellipsoid(x, y, z, (0, 0.62, 0.05), (0.62, 0.45, 0.36))
    for side in (-1, 1):
        shoulder = _capsule(x, y, z, (side * 0.3, 0.93, 0.08), (side * 0.72, 0.62, 0.08), 0.18, 0.24)
        chest = _join(chest, shoulder, 0.2)
    folds = 0.012 * np.sin(14 * x + 10 * y + a) * np.sin(5 * y - 6 * x + b)
    d = _join(d, chest + folds, 0.15)
    # the figure ends in a soft curve above its plinth
    d = np.maximum(d, 0.36 + 0.25 * (x / 0.8) ** 2 - y)
    round_ = np.hypot(x, z - 0.05)
    stem = np.maximum(round_ - (0.2 + 0.35 * (y - 0.3) ** 2), np.maximum(0.1 - y, y - 0.55))
    d = _join(d, stem, 0.05)
    plinth = np.maximum(round_ - 0.42 + 0.1 * y, np.maximum(-y, y - 0.13))
    return _join(d, plinth, 0.03)
