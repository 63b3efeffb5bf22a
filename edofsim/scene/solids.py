"""Triangle meshes of simple solids, in local metres: x right, y up, z away from the camera.

Faces are wound so that (b - a) x (c - a), taken by coordinates, points out of the solid; the front of a
panel faces the camera, -z. Texture coordinates start at the lower left as seen from outside.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError
from .model import TriangleMesh


def mesh(
    vertices: np.ndarray,
    faces: np.ndarray,
    uv: np.ndarray | None = None,
    normals: np.ndarray | None = None,
) -> TriangleMesh:
    """A TriangleMesh with its arrays in their types.

    vertices: [vertex, 3], metres.
    faces: [face, 3], numbers of vertices.
    uv: [vertex, 2]; None for none.
    normals: [vertex, 3]; None for none.
    """
    return TriangleMesh(
        np.ascontiguousarray(vertices, np.float32),
        np.ascontiguousarray(faces, np.uint32),
        None if uv is None else np.ascontiguousarray(uv, np.float32),
        None if normals is None else np.ascontiguousarray(normals, np.float32),
    )


def join(parts: Sequence[TriangleMesh]) -> TriangleMesh:
    """Several meshes as one; all of them have uv, or none, and so for normals."""
    offsets = np.cumsum([0, *(len(p.vertices) for p in parts)])
    optional = {
        key: None if getattr(parts[0], key) is None else np.concatenate([getattr(p, key) for p in parts])
        for key in ("uv", "normals")
    }
    faces = [p.faces + np.uint32(o) for p, o in zip(parts, offsets[:-1], strict=True)]
    return mesh(np.concatenate([p.vertices for p in parts]), np.concatenate(faces), **optional)


def moved(part: TriangleMesh, matrix: np.ndarray | None = None, shift: ArrayLike = (0, 0, 0)) -> TriangleMesh:
    """A mesh after a linear map (float [3, 3]) and a shift in metres.

    matrix: [3, 3].
    shift: [3], metres.

    Where the map mirrors, the faces are turned, so that they still point outward.
    """
    if matrix is None:
        return TriangleMesh(part.vertices + np.asarray(shift, np.float32), part.faces, part.uv, part.normals)
    vertices = part.vertices @ np.asarray(matrix).T + np.asarray(shift)
    normals = part.normals
    if normals is not None:
        normals = normals @ np.linalg.inv(matrix)
        normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    faces = part.faces if np.linalg.det(matrix) > 0 else part.faces[:, ::-1]
    return mesh(vertices, faces, part.uv, normals)


def quad(corners: ArrayLike, uv: ArrayLike | None = None) -> TriangleMesh:
    """A flat quadrilateral: lower left, lower right, upper right, upper left as seen from its front.

    corners: [4, 3], metres.
    uv: [4, 2].
    """
    square = [(0, 0), (1, 0), (1, 1), (0, 1)] if uv is None else uv
    return mesh(np.array(corners), np.array([[0, 3, 2], [0, 2, 1]]), np.array(square))


def panel(width: float, height: float, centre: ArrayLike = (0, 0, 0)) -> TriangleMesh:
    """A rectangle that faces the camera.

    centre: [3], metres.
    """
    x, y = width / 2, height / 2
    corners = np.array([(-x, -y, 0), (x, -y, 0), (x, y, 0), (-x, y, 0)]) + np.asarray(centre)
    return quad(corners)


def box(size: ArrayLike, centre: ArrayLike = (0, 0, 0)) -> TriangleMesh:
    """A block of `size` (x, y, z) with each side's texture coordinates from 0 to 1.

    size, centre: [3], metres.
    """
    x, y, z = np.asarray(size) / 2
    sides = [
        [(-x, -y, -z), (x, -y, -z), (x, y, -z), (-x, y, -z)],  # front
        [(x, -y, z), (-x, -y, z), (-x, y, z), (x, y, z)],  # back
        [(-x, -y, z), (-x, -y, -z), (-x, y, -z), (-x, y, z)],  # left
        [(x, -y, -z), (x, -y, z), (x, y, z), (x, y, -z)],  # right
        [(-x, y, -z), (x, y, -z), (x, y, z), (-x, y, z)],  # top
        [(-x, -y, z), (x, -y, z), (x, -y, -z), (-x, -y, -z)],  # bottom
    ]
    return moved(join([quad(side) for side in sides]), shift=centre)


def grid_faces(rows: int, columns: int) -> np.ndarray:
    """Faces of a grid of vertices [row, column], seen from its front with rows upwards, columns right."""
    index = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = (i.ravel() for i in (index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]))
    return np.concatenate([np.stack([a, d, c], 1), np.stack([a, c, b], 1)])


def without_degenerate(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """The faces that have an area.

    vertices: [vertex, 3], metres.
    faces: [face, 3], numbers of vertices.
    """
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    twice_area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    size = np.ptp(vertices, axis=0).max()
    return faces[twice_area > 1e-12 * size**2]


def lathe(profile: ArrayLike, segments: int = 64, smooth: bool = True) -> TriangleMesh:
    """A profile turned about the y axis.

    profile: [point, 2]: (radius, y) from the bottom up along the outside; a hollow body goes on down its
        inside.
    """
    points = np.asarray(profile, float)
    runs = _smooth_runs(points) if smooth else [points[i : i + 2] for i in range(len(points) - 1)]
    along = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    start = 0
    parts: list[TriangleMesh] = []
    for run in runs:
        v = along[start : start + len(run)] / along[-1]
        parts.append(_lathe_run(run, v, segments))
        start += len(run) - 1
    return join(parts)


def _smooth_runs(points: np.ndarray) -> list[np.ndarray]:
    steps = np.diff(points, axis=0)
    angle = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    bends = np.flatnonzero(np.abs(np.diff(angle)) > np.radians(40)) + 1
    edges = [0, *bends, len(points) - 1]
    return [points[a : b + 1] for a, b in zip(edges[:-1], edges[1:], strict=True)]


def _circle(segments: int) -> np.ndarray:
    """x and z around the axis, float64 [segments + 1, 2]."""
    phi = np.linspace(0, 2 * np.pi, segments + 1)
    # phi = 0 faces away from the camera, so that a texture's middle is in front and its seam behind
    circle = np.stack([-np.sin(phi), np.cos(phi)], 1)
    circle[-1] = circle[0]  # to the last bit, so that the body is closed
    return circle


def _lathe_run(run: np.ndarray, v: np.ndarray, segments: int) -> TriangleMesh:
    circle = _circle(segments)
    steps = np.diff(run, axis=0)
    tangent = np.zeros_like(run)
    tangent[:-1] += steps / np.linalg.norm(steps, axis=1, keepdims=True)
    tangent[1:] += steps / np.linalg.norm(steps, axis=1, keepdims=True)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    for end in (0, -1):  # a rounded end is level on the axis; a point, as of a cone, is not
        if run[end, 0] == 0 and abs(tangent[end, 0]) > np.cos(np.radians(40)):
            tangent[end] = (np.sign(tangent[end, 0]), 0.0)
    radial, up = tangent[:, 1], -tangent[:, 0]
    vertices = np.empty((len(run), segments + 1, 3))
    normals = np.empty_like(vertices)
    vertices[..., 0], vertices[..., 2] = (run[:, 0, None] * circle[:, i] for i in (0, 1))
    vertices[..., 1] = run[:, 1, None]
    normals[..., 0], normals[..., 2] = (radial[:, None] * circle[:, i] for i in (0, 1))
    normals[..., 1] = up[:, None]
    uv = np.stack(np.broadcast_arrays(np.linspace(0, 2 * np.pi, segments + 1) / (2 * np.pi), v[:, None]), -1)
    vertices = vertices.reshape(-1, 3)
    faces = without_degenerate(vertices, grid_faces(len(run), segments + 1))
    return mesh(vertices, faces, uv.reshape(-1, 2), normals.reshape(-1, 3))


@lru_cache(maxsize=64)
def sphere(radius: float, segments: int = 64) -> TriangleMesh:
    """A ball about the origin; read-only, for it is shared."""
    unit, circle = _unit_ball(segments), _circle(segments)
    profile = radius * _meridian(segments)
    vertices = np.empty((len(profile), len(circle), 3), np.float32)
    vertices[..., 0], vertices[..., 2] = (profile[:, 0, None] * circle[:, i] for i in (0, 1))
    vertices[..., 1] = profile[:, 1, None]
    return TriangleMesh(vertices.reshape(-1, 3), unit.faces, unit.uv, unit.normals)


@lru_cache(maxsize=64)
def _unit_ball(segments: int) -> TriangleMesh:
    return lathe(_meridian(segments), segments)


def _meridian(segments: int) -> np.ndarray:
    """(radius, y) of a unit ball from its south pole up."""
    theta = np.linspace(-np.pi / 2, np.pi / 2, segments // 2 + 1)
    profile = np.stack([np.cos(theta), np.sin(theta)], 1)
    profile[[0, -1], 0] = 0
    return profile


def prism(sides: int, radius: float, height: float) -> TriangleMesh:
    """A regular prism from y = 0 to `height`, closed at both ends; flat faces."""
    return flat_shaded(lathe([(0, 0), (radius, 0), (radius, height), (0, height)], sides, smooth=False))


def inside_out(part: TriangleMesh) -> TriangleMesh:
    """The same mesh with its faces and normals the other way round."""
    return mesh(part.vertices, part.faces[:, ::-1], part.uv, None if part.normals is None else -part.normals)


def flat_shaded(part: TriangleMesh) -> TriangleMesh:
    """The same mesh without vertex normals: every triangle is shaded flat."""
    return TriangleMesh(part.vertices, part.faces, part.uv)


def smooth_path(points: np.ndarray, closed: bool = False) -> np.ndarray:
    """Points on the cubic spline through `points`, float [point, 3]; two points give a straight line.

    points: [point, 3], metres.

    The knots are spaced by the root of the chords (centripetal), which keeps close points free of loops.
    Raises InputError where two points that follow each other are the same.
    """
    if closed:
        points = np.concatenate([points, points[:1]])
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    if (steps == 0).any():
        raise InputError(f"points {int(np.argmin(steps)) + 1} and the next of the curve are the same")
    if len(points) == 2:
        return points
    knots = np.concatenate([[0], np.cumsum(np.sqrt(steps))])
    path = _cubic_spline(knots, points, np.linspace(0, knots[-1], 12 * len(points)), closed)
    return path[:-1] if closed else path


def _cubic_spline(knots: np.ndarray, points: np.ndarray, at: np.ndarray, closed: bool) -> np.ndarray:
    """The cubic spline through points [knot, 3] at parameters [n]: its curvature is zero at both ends, or
    goes on from one to the other. SciPy has it, too, but takes a quarter of a second to load."""
    gaps = np.diff(knots)
    slopes = np.diff(points, axis=0) / gaps[:, None]
    # second derivatives, so that first ones are equal on both sides of each knot
    matrix, jumps = np.eye(len(knots)), np.zeros_like(points)
    inner = range(1, len(gaps))
    for i, before, after in [*((i, i - 1, i) for i in inner), *([(0, -1, 0)] if closed else [])]:
        matrix[i, i] = (gaps[before] + gaps[after]) / 3
        matrix[i, before if i else -2] = gaps[before] / 6
        matrix[i, after + 1] += gaps[after] / 6
        jumps[i] = slopes[after] - slopes[before]
    if closed:
        matrix[-1, 0] = -1
    bend = np.linalg.solve(matrix, jumps)
    piece = np.clip(np.searchsorted(knots, at, side="right") - 1, 0, len(gaps) - 1)
    gap = gaps[piece][:, None]
    right = (at[:, None] - knots[piece][:, None]) / gap
    left = 1 - right
    bulge = (left**3 - left) * bend[piece] + (right**3 - right) * bend[piece + 1]
    return left * points[piece] + right * points[piece + 1] + gap**2 / 6 * bulge


def tube(points: np.ndarray, radius: float, sides: int = 12, closed: bool = False) -> TriangleMesh:
    """A round tube along a polyline, float [point, 3]; ends are capped unless `closed`.

    points: [point, 3], metres.

    The rings are carried along without twist (double reflection of Wang et al., TOG 2008).
    """
    points = np.asarray(points, float)
    if closed:
        points = np.concatenate([points, points[:1]])
    tangents = np.gradient(points, axis=0)
    if closed:
        tangents[0] = tangents[-1] = points[1] - points[-2]
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    first = np.cross(tangents[0], np.eye(3)[np.argmin(np.abs(tangents[0]))])
    frames = [first / np.linalg.norm(first)]
    for i in range(len(points) - 1):
        frames.append(_double_reflection(frames[-1], tangents[i], tangents[i + 1], points[i + 1] - points[i]))
    normal = np.stack(frames)
    other = np.cross(tangents, normal)
    if closed:  # spread the closing angle over the length, so that the last ring meets the first
        angle = np.arctan2((normal[-1] * other[0]).sum(), (normal[-1] * normal[0]).sum())
        a = -np.linspace(0, angle, len(points))[:, None]
        normal, other = np.cos(a) * normal + np.sin(a) * other, np.cos(a) * other - np.sin(a) * normal
    phi = np.linspace(0, 2 * np.pi, sides + 1)
    out = np.cos(phi)[None, :, None] * normal[:, None] + np.sin(phi)[None, :, None] * other[:, None]
    out[:, -1] = out[:, 0]  # to the last bit, so that the tube is closed
    if closed:
        out[-1] = out[0]
    vertices = points[:, None] + radius * out
    length = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    uv = np.stack(np.broadcast_arrays(phi / (2 * np.pi), (length / length[-1])[:, None]), -1)
    faces = grid_faces(len(points), sides + 1)[:, ::-1]
    parts = [mesh(vertices.reshape(-1, 3), faces, uv.reshape(-1, 2), out.reshape(-1, 3))]
    if not closed:
        parts += [
            _cap(vertices[0, :-1], -tangents[0], points[0]),
            _cap(vertices[-1, :-1][::-1], tangents[-1], points[-1]),
        ]
    return join(parts)


def _double_reflection(r: np.ndarray, t0: np.ndarray, t1: np.ndarray, step: np.ndarray) -> np.ndarray:
    c = step @ step
    r_left, t_left = r - 2 / c * (step @ r) * step, t0 - 2 / c * (step @ t0) * step
    second = t1 - t_left
    c = second @ second
    return r_left if c < 1e-24 else r_left - 2 / c * (second @ r_left) * second


def _cap(ring: np.ndarray, normal: np.ndarray, centre: np.ndarray) -> TriangleMesh:
    n = len(ring)
    faces = np.stack([np.full(n, n), (np.arange(n) + 1) % n, np.arange(n)], 1)
    vertices = np.concatenate([ring, centre[None]])
    return mesh(vertices, faces, np.full((n + 1, 2), 0.5), np.broadcast_to(normal, (n + 1, 3)))


def signed_volume(part: TriangleMesh) -> float:
    """Volume enclosed by a closed mesh in m3; positive where its faces point outward."""
    a, b, c = (part.vertices[part.faces[:, i]].astype(float) for i in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


def smooth_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Vertex normals as the means of their faces' normals, weighted by area, float64 [vertex, 3].

    vertices: [vertex, 3], metres.
    faces: [face, 3], numbers of vertices.
    """
    a, b, c = (np.asarray(vertices, float)[faces[:, i]] for i in range(3))
    normals = np.zeros((len(vertices), 3))
    for corner in range(3):
        np.add.at(normals, faces[:, corner], np.cross(b - a, c - a))
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.where(length > 0, normals / np.maximum(length, 1e-30), [0.0, 1.0, 0.0])


def loft(sections: np.ndarray) -> TriangleMesh:
    """A body through closed cross-sections, float [section, point, 3], ordered along +x; flat at both ends.

    sections: [section, point, 3], metres, ordered along +x.

    The points of a section run counter-clockwise seen with z to the right and y up.
    """
    count, points, _ = sections.shape
    index = np.arange(count * points).reshape(count, points)
    after = np.roll(index, -1, axis=1)
    a, b, c, d = (i.ravel() for i in (index[:-1], after[:-1], after[1:], index[1:]))
    faces = np.concatenate([np.stack([a, c, b], 1), np.stack([a, d, c], 1)])
    vertices = sections.reshape(-1, 3)
    u = np.broadcast_to(np.linspace(0, 1, count)[:, None], (count, points))
    v = np.broadcast_to(np.linspace(0, 1, points)[None], (count, points))
    side = mesh(vertices, faces, np.stack([u, v], -1).reshape(-1, 2), smooth_normals(vertices, faces))
    ends = [
        _cap(sections[0][::-1], np.array([-1.0, 0, 0]), sections[0].mean(axis=0)),
        _cap(sections[-1], np.array([1.0, 0, 0]), sections[-1].mean(axis=0)),
    ]
    return join([side, *ends])
