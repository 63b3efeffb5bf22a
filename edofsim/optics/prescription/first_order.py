"""Rays near the axis: focal length, pupils, images. Lengths in millimetres, plain numbers."""

from __future__ import annotations

import math
from dataclasses import dataclass

from torch import Tensor

from .surfaces import Stack


@dataclass(frozen=True)
class FirstOrder:
    """A lens in air near its axis. Planes are counted from the first vertex (entrance) or the last (focus,
    exit).

    focal: length.
    focus: of light from infinity.
    entrance, exit: where the pupils' centres are.
    opening: radius of the entrance pupil over that of the stop.
    """

    surfaces: tuple[tuple[float, float, float, float], ...]
    focal: float
    focus: float
    entrance: float
    exit: float
    opening: float

    def image(self, distance: float, moved: float = 0.0) -> tuple[float, float]:
        """(plane so far behind the image, height there for a chief ray of slope 1) of a point so far before
        the first vertex, infinite too."""
        height, slope = _forward(self.surfaces, *((1.0, 0.0) if math.isinf(distance) else (distance, 1.0)))
        plane = -height / slope + moved if slope else math.inf
        chief, rises = _forward(self.surfaces, -self.entrance, 1.0)
        return plane, chief + plane * rises


def first_order(lens: Stack, index: Tensor) -> FirstOrder:
    """index: [surface + 1], at one wavelength. The r^2 term of an asphere bends as its curvature does."""
    curvature = lens.curvature + (2 * lens.even[:, 0] if lens.even.shape[1] else 0)
    n = index.tolist()
    rows = tuple(zip(n[:-1], n[1:], curvature.tolist(), lens.thickness.tolist(), strict=True))
    height, slope = _forward(rows, 1.0, 0.0)
    focal = -1 / slope if slope else math.inf
    focus = -height / slope if slope else math.inf
    height, slope = _forward(rows[lens.stop :], 0.0, 1.0)
    exit_ = -height / slope if slope else math.inf
    centre, through = _backward(rows[: lens.stop], 0.0, 1.0)
    rim, bent = _backward(rows[: lens.stop], 1.0, 0.0)
    entrance = -centre / through if through else math.inf
    # the ray that meets the stop's rim and is parallel in front: what of the second ray cancels its slope
    opening = rim - centre * bent / through if through else math.inf
    return FirstOrder(rows, focal, focus, entrance, exit_, abs(opening))


def _forward(
    surfaces: tuple[tuple[float, float, float, float], ...], height: float, slope: float
) -> tuple[float, float]:
    """(height on the last vertex plane, slope behind it) of a ray that meets the first one so."""
    for number, (before, after, curvature, _) in enumerate(surfaces):
        if number:
            height += slope * surfaces[number - 1][3]
        slope = (before * slope - height * curvature * (after - before)) / after
    return height, slope


def _backward(
    surfaces: tuple[tuple[float, float, float, float], ...], height: float, slope: float
) -> tuple[float, float]:
    """(height on the first vertex plane, slope before it) of a ray that gets to the surface behind these
    so."""
    for before, after, curvature, thickness in reversed(surfaces):
        height -= slope * thickness
        slope = (after * slope + height * curvature * (after - before)) / before
    return height, slope
