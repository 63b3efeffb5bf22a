"""Where a pupil looks behind an edge that the pinhole cannot look behind."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np

LANES = 1 << 20

EXTENT = 2**0.5
"""Pixels whose centres are so far apart may still touch."""


def seen_around(nearest: np.ndarray, farthest: np.ndarray, gap: float, reach: float) -> np.ndarray:
    """Pixels that some point of the pupil looks behind, bool [y, x].

    From a point of the pupil at distance a from its centre, a surface at inverse depth d is shifted by a d
    against infinity, in tangents; so behind the surface at p, that of a farther pixel q comes into sight if q
    is nearer to p than `reach` (nearest(p) - farthest(q)) pixels.

    reach: pupil radius over pixel angle, in pixels per 1/m.
    nearest: float32 [y, x], of the surface to look behind, -inf where there is none.
    farthest: float32 [y, x], of what the pinhole sees. Differences of less than `gap` are one surface.
    """
    rows, columns = nearest.shape
    found = nearest - farthest > gap
    if not np.isfinite(nearest).any():
        return found
    widest = EXTENT + reach * float(nearest.max() - farthest.min())
    radius = min(int(np.ceil(widest)), max(rows, columns))
    if radius < 1:
        return found
    undecided, first_ring, last_ring = _bounded(nearest, farthest, gap, reach, radius, found)
    open_pixels = np.flatnonzero(undecided)
    dy, dx = np.mgrid[-radius : radius + 1, -radius : radius + 1]
    distance = np.hypot(dy, dx).ravel()
    order = np.argsort(distance, kind="stable")[1:]
    order = order[distance[order] <= radius]
    padded = np.pad(farthest, radius, constant_values=np.inf)
    steps = (dy * padded.shape[1] + dx).ravel()[order]
    table = mi.Float(padded.ravel())
    offsets = mi.Int32(steps.astype(np.int32))
    needed = mi.Float(np.maximum(gap, (distance[order] - EXTENT) / reach).astype(np.float32))
    begin = np.searchsorted(distance[order], np.arange(radius + 1), side="right").astype(np.uint32)
    for start in range(0, len(open_pixels), LANES):
        chosen = open_pixels[start : start + LANES]
        place = (chosen // columns + radius) * padded.shape[1] + chosen % columns + radius
        first, end = (mi.UInt32(begin[ring.ravel()[chosen]]) for ring in (first_ring, last_ring))
        level = mi.Float(np.ascontiguousarray(nearest.ravel()[chosen]))
        found.ravel()[chosen] = np.array(
            _search(table, offsets, needed, mi.Int32(place.astype(np.int32)), level, first, end)
        )
    return found


def _bounded(
    nearest: np.ndarray, farthest: np.ndarray, gap: float, reach: float, radius: int, found: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Decide what minima over squares decide: a square inside the disc proves that something is in sight (and
    is marked in `found`), one around it that nothing is. Returns the pixels that stay open, bool [y, x], and
    two distances in pixels, up to the first and beyond the second of which nothing is in sight of each, int
    [y, x]."""
    open_pixels = np.zeros(nearest.shape, bool)
    clear_to = np.zeros(nearest.shape, np.int64)
    clear_from = np.zeros(nearest.shape, np.int64)
    inner = 0
    while inner < radius:
        outer = min(radius, max(inner + 1, int(inner * 1.25)))
        drop = nearest - _window_minimum(_window_minimum(farthest, outer, 0), outer, 1)
        found |= drop > max(gap, (outer * np.sqrt(2) - EXTENT) / reach)
        possible = drop > max(gap, (inner - EXTENT) / reach)
        clear_to[~open_pixels & ~possible] = outer
        clear_from[possible] = outer
        open_pixels |= possible
        inner = outer
    return open_pixels & ~found, clear_to, clear_from


@dr.syntax
def _search(
    table: mi.Float,
    offsets: mi.Int32,
    needed: mi.Float,
    place: mi.UInt32,
    level: mi.Float,
    first: mi.UInt32,
    end: mi.UInt32,
) -> mi.Bool:
    """Whether table[place + offset] is below level by more than what is needed there, for any offset
    from number `first` to before `end`."""
    number = mi.UInt32(first)
    hit = dr.full(mi.Bool, False, dr.width(place))
    while (number < end) & ~hit:
        at = mi.UInt32(place + dr.gather(mi.Int32, offsets, number))
        hit |= level - dr.gather(mi.Float, table, at) > dr.gather(mi.Float, needed, number)
        number += 1
    return hit


def _window_minimum(values: np.ndarray, radius: int, axis: int) -> np.ndarray:
    """Minimum over 2 radius + 1 neighbours along an axis, in a number of passes that grows as log(radius)."""
    pad = [(0, 0), (0, 0)]
    pad[axis] = (radius, radius)
    out = np.pad(values, pad, constant_values=np.inf)
    span = 1
    while span < 2 * radius + 1:
        step = min(span, 2 * radius + 1 - span)
        near, far = (slice(None), slice(-step)), (slice(None), slice(step, None))
        out = np.minimum(*(out[part if axis else part[::-1]] for part in (near, far)))
        span += step
    return out
