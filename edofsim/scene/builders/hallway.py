"""A corridor: five slanted planes, doors along the sides, and panels in the ceiling that shine."""

from __future__ import annotations

import numpy as np

from ...recipe.places import Hallway
from .. import solids
from ..spectra import illuminant
from ..surfaces import matt
from ..textures import flat
from .context import Context, Part

MM = 1e-3


def hallway(recipe: Hallway, context: Context) -> list[Part]:
    """The corridor in camera space but for x_mm and y_mm: its floor lies at y = 0."""
    w, h = recipe.width_mm / 2 * MM, recipe.height_mm * MM
    near, far = recipe.near_m, recipe.far_m
    tiles = (far - near) / (2 * w)
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
    if recipe.lamps:
        shine = recipe.lamp_radiance * illuminant(recipe.lamp_illuminant, context.wavelengths)
        lamp = _lamps(recipe, w, h)
        parts.append(Part("lamps", lamp, matt(flat(0.0, context.wavelengths)), shine.astype(np.float32)))
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
        doors.append(solids.box((thick, 0.72 * h, 0.8 * w), (side * (w - thick / 2), 0.36 * h, z)))
    return solids.join(doors)


def _lamps(recipe: Hallway, w: float, h: float):
    y = h * (1 - 1e-3)
    panels = []
    for z in _spread(recipe.lamps, recipe.near_m, recipe.far_m):
        x, half = 0.35 * w, 0.12 * z
        panels.append(solids.quad([(-x, y, z + half), (x, y, z + half), (x, y, z - half), (-x, y, z - half)]))
    return solids.join(panels)
