"""A corridor: five slanted planes, doors along the sides, and panels in the ceiling that shine."""

from __future__ import annotations

import numpy as np

from ...recipe.places import Hallway
from .. import solids
from ..model import TriangleMesh
from ..spectra import illuminant
from ..surfaces import matt
from ..textures import flat
from .context import Context, Part

MM = 1e-3


def hallway(recipe: Hallway, context: Context) -> list[Part]:
    """The corridor in camera space but for x_mm and y_mm: its floor lies at y = 0."""
    w, h = recipe.width_mm / 2 * MM, recipe.height_mm * MM
    near, far = recipe.near_m, recipe.far_m
    tiles = (far - near) / (8 * w)
    floor = solids.quad(
        [(-w, 0, near), (w, 0, near), (w, 0, far), (-w, 0, far)], [(0, 0), (1, 0), (1, tiles), (0, tiles)]
    )
    ceiling = solids.quad([(-w, h, far), (w, h, far), (w, h, near), (-w, h, near)])
    left = solids.quad([(-w, 0, near), (-w, 0, far), (-w, h, far), (-w, h, near)], _tiled(tiles))
    right = solids.quad([(w, 0, far), (w, 0, near), (w, h, near), (w, h, far)], _tiled(tiles))
    parts = [
        Part("floor", floor, context.surface(recipe.floor, "floor")),
        Part("ceiling", ceiling, context.surface(recipe.ceiling, "ceiling")),
        Part("walls", solids.join([left, right]), context.surface(recipe.walls, "walls")),
        Part("end", solids.panel(2 * w, h, (0, h / 2, far)), context.surface(recipe.end, "end")),
    ]
    if recipe.doors:
        parts.append(Part("doors", _doors(recipe, w, h), context.surface(recipe.door, "door")))
    shine = recipe.lamp_radiance * illuminant(recipe.lamp_illuminant, context.wavelengths)
    black = matt(flat(0.0, context.wavelengths))
    for number, lamp in enumerate(_lamps(recipe, w, h), start=1):
        # one object each, so that a light is chosen as often far away, where lamps are long, as nearby
        parts.append(Part(f"lamp {number}", lamp, black, shine.astype(np.float32)))
    return parts


def _tiled(tiles: float) -> list[tuple[float, float]]:
    return [(0, 0), (tiles, 0), (tiles, 1), (0, 1)]


def _spread(count: int, near: float, far: float) -> np.ndarray:
    """Depths that look evenly spaced: even in the middle between depth and its inverse."""
    t = (np.arange(count) + 0.5) / count
    return np.exp(np.log(near) + t * np.log(far / near))


def _doors(recipe: Hallway, w: float, h: float):
    thick = 0.03 * w
    doors = []
    for i, z in enumerate(_spread(recipe.doors, recipe.near_m, recipe.far_m)):
        side = -1 if i % 2 == 0 else 1
        doors.append(solids.box((thick, 0.72 * h, 0.2 * z), (side * (w - thick / 2), 0.36 * h, z)))
    return solids.join(doors)


def _lamps(recipe: Hallway, w: float, h: float) -> list[TriangleMesh]:
    """A strip of light along the ceiling, in pieces with small gaps that look equally long."""
    y, x = h * (1 - 1e-3), 0.55 * w
    ends = np.exp(np.linspace(np.log(recipe.near_m), np.log(recipe.far_m), recipe.lamps + 1))
    lamps = []
    for near, far in zip(ends[:-1], ends[1:], strict=True):
        near += 0.06 * (far - near)
        lamps.append(solids.quad([(-x, y, far), (x, y, far), (x, y, near), (-x, y, near)]))
    return lamps
