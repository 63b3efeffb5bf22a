"""Which part of the pupil sees a fragment: rays from a grid of pupil points through the scene."""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import mitsuba as mi

DEPTH_SLACK = 0.01
"""A surface nearer by less than this, in 1/m, is the fragment's own: a third of a pixel of blur."""
LAUNCH = 1 << 22
"""Rays of one launch."""
PLACES = 4
"""A fragment that fills a pixel in part is looked for at 4 x 4 places in the pixel."""
SURFACES = 6
"""Surfaces along a pixel's ray that are looked at to find a fragment's own."""


def pupil_points(count: int, radius: float) -> np.ndarray:
    """Centres of count x count cells over a square of half-width `radius` around the pupil's centre: (s, t)
    in metres, float64 [y, x, 2]; row 0 is the top."""
    axis = ((np.arange(count) + 0.5) / count * 2 - 1) * radius
    s, t = np.meshgrid(axis, -axis)
    return np.stack([s, t], axis=2)


def visible(
    mi: ModuleType,
    scene: mi.Scene,
    directions: np.ndarray,
    inverse_depth: np.ndarray,
    points: np.ndarray,
    progress: Callable[[float], None] | None = None,
    shift: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Which pupil points see each fragment: (bool [fragment, y, x], how much nearer what blocks it is).

    directions: [fragment, 3] as `pixel_directions`.
    inverse_depth: [fragment] in 1/m, 0 at infinity.
    points: [y, x, 2], from `pupil_points`.
    shift: [fragment, 2], moves all points of a fragment together by this many spacings: the edges of the
        shadows of many then lie where they should on average, and not at the same points always.

    The second is the sum over blocked points of the difference in inverse depth between what blocks and what
    is blocked, [fragment] in 1/m.
    """
    flat = points.reshape(-1, 2)
    moved = np.zeros((len(directions), 2)) if shift is None else shift * (points[0, 1, 0] - points[0, 0, 0])
    seen = np.empty((len(directions), len(flat)), bool)
    nearer = np.empty(len(directions))
    step = max(1, LAUNCH // len(flat))
    for start in range(0, len(directions), step):
        part = slice(start, start + step)
        gap = _gaps(mi, scene, directions[part], inverse_depth[part], flat, moved[part])
        seen[part] = gap <= DEPTH_SLACK
        nearer[part] = np.where(seen[part], 0.0, gap).sum(1)
        if progress:
            progress(min(1.0, (start + step) / len(directions)))
    return seen.reshape(-1, *points.shape[:2]), nearer


def _gaps(
    mi: ModuleType,
    scene: mi.Scene,
    directions: np.ndarray,
    inverse_depth: np.ndarray,
    points: np.ndarray,
    shift: np.ndarray,
) -> np.ndarray:
    """How much nearer than fragments [n] lies what rays to them from pupil points [m] meet first, in 1/m:
    [n, m]. shift: of all points of a fragment, [n, 2]."""
    import drjit as dr

    def floats(values: np.ndarray) -> mi.Float:
        return mi.Float(np.ascontiguousarray(values, np.float32))

    count = len(points)
    lane = dr.arange(mi.UInt32, len(directions) * count)
    fragment = lane // dr.opaque(mi.UInt32, count)
    point = lane - fragment * dr.opaque(mi.UInt32, count)

    def of_fragment(values: np.ndarray) -> mi.Float:
        return dr.gather(mi.Float, floats(values), fragment)

    s = dr.gather(mi.Float, floats(points[:, 0]), point) + of_fragment(shift[:, 0])
    t = dr.gather(mi.Float, floats(points[:, 1]), point) + of_fragment(shift[:, 1])
    depth = of_fragment(inverse_depth)
    # towards the fragment's place if it has one: (P - S) / z, which for z = inf is the direction itself
    towards = mi.Vector3f(
        of_fragment(directions[:, 0]) - s * depth, of_fragment(directions[:, 1]) - t * depth, 1.0
    )
    length = dr.norm(towards)
    hit = scene.ray_intersect_preliminary(mi.Ray3f(mi.Point3f(s, t, 0.0), towards / length))
    here = dr.select(dr.isfinite(hit.t), length / dr.maximum(hit.t, 1e-9), 0.0)
    return np.array(here - depth).reshape(len(directions), count)


def places_of(
    mi: ModuleType,
    scene: mi.Scene,
    at: Callable[[float, float], np.ndarray],
    inverse_depth: np.ndarray,
    hidden: np.ndarray,
) -> np.ndarray:
    """Where in their pixels fragments lie: bool [place, place, fragment], all true where that is unclear.

    at: gives directions [fragment, 3] at an offset from the pixels' centres.
    inverse_depth: [fragment], 1/m.
    hidden: [fragment], bool.

    at(down, right): directions [fragment, 3] at an offset from the pixels' centres. A visible fragment is
    where the pixel's ray meets its depth first, a hidden one where the ray meets it behind something else.
    """
    found = np.zeros((PLACES, PLACES, len(inverse_depth)), bool)
    offsets = (np.arange(PLACES) + 0.5) / PLACES - 0.5
    for i, down in enumerate(offsets):
        for j, right in enumerate(offsets):
            found[i, j] = _meets(mi, scene, at(down, right), inverse_depth, hidden)
    found[:, :, ~found.any((0, 1))] = True
    return found


def _meets(
    mi: ModuleType, scene: mi.Scene, directions: np.ndarray, inverse_depth: np.ndarray, hidden: np.ndarray
) -> np.ndarray:
    """Whether rays through the pinhole meet a surface at a depth: first (visible), or later (hidden)."""
    slack = 2 * DEPTH_SLACK
    origin = np.zeros((len(directions), 3))
    met = np.zeros(len(directions), bool)
    for number in range(SURFACES):
        here = _hits(mi, scene, origin, directions)
        same = np.abs(here - inverse_depth) <= slack
        met |= same & (hidden == (number > 0))
        beyond = here > 0
        if not beyond.any() or not hidden.any():
            break
        depth = np.where(beyond, 1 / np.where(beyond, here, 1.0), origin[:, 2])
        origin = directions * (depth * (1 + 1e-5) + 1e-6)[:, None]
    return met


def first_hits(mi: ModuleType, scene: mi.Scene, directions: np.ndarray) -> np.ndarray:
    """Inverse depth of what rays through the pinhole meet first, 0 for nothing: float64 [n].

    directions: [n, 3].
    """
    return _hits(mi, scene, np.zeros((len(directions), 3)), directions)


def _hits(mi: ModuleType, scene: mi.Scene, origin: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Inverse depth of the first surface along rays whose direction has z = 1, 0 for none: float64 [n]."""
    length = np.linalg.norm(direction, axis=1)
    unit = direction / length[:, None]
    ray = mi.Ray3f(
        mi.Point3f(*(mi.Float(np.ascontiguousarray(c, np.float32)) for c in origin.T)),
        mi.Vector3f(*(mi.Float(np.ascontiguousarray(c, np.float32)) for c in unit.T)),
    )
    hit = scene.ray_intersect_preliminary(ray)
    distance = np.array(hit.t, np.float64)
    depth = origin[:, 2] + distance / length
    return np.where(np.isfinite(distance), 1 / np.maximum(depth, 1e-9), 0.0)
