"""What stands around the objects: table-top, wall with a window."""

from __future__ import annotations

import numpy as np

from ...recipe.places import Table, Wall, WindowOpening
from .. import solids
from ..model import TriangleMesh
from .context import Context, Part

MM = 1e-3


def table(recipe: Table, context: Context) -> list[Part]:
    """A slab whose top lies at y = 0, from near_m to far_m; already in camera space but for its height."""
    w, t = recipe.width_mm * MM, recipe.thickness_mm * MM
    near, far = recipe.near_m, recipe.far_m
    across, along = (size * MM for size in recipe.tile_mm)
    slab = solids.box((w, t, far - near), (0, -t / 2, (near + far) / 2))
    # texture tiles: x and depth, and on the sides depth and height
    x, y, z = slab.vertices.astype(float).T
    uv = np.stack([x / across, (z - near - y) / along], axis=1)
    return [
        Part("", solids.mesh(slab.vertices, slab.faces, uv), context.surface(recipe.surface)),
    ]


def wall(recipe: Wall, context: Context) -> list[Part]:
    """A wall about its centre, with a window's opening, frame and bars where the recipe has one."""
    half = np.array([recipe.width_mm, recipe.height_mm]) / 2 * MM
    surface = context.surface(recipe.surface)
    if recipe.window is None:
        return [Part("", solids.panel(*(2 * half)), surface)]
    window = recipe.window
    centre = np.array([window.x_mm, window.y_mm]) * MM
    low = centre - np.array([window.width_mm, window.height_mm]) / 2 * MM
    high = centre + np.array([window.width_mm, window.height_mm]) / 2 * MM
    rectangles = [
        (-half, (low[0], half[1])),
        ((high[0], -half[1]), half),
        ((low[0], -half[1]), (high[0], low[1])),
        ((low[0], high[1]), (high[0], half[1])),
    ]
    pieces = [_rectangle(np.array(a), np.array(b), half) for a, b in rectangles]
    parts = [Part("", solids.join(pieces), surface)]
    if window.frame_mm > 0:
        parts.append(Part("window", _frame(window, low, high), context.surface(window.surface, "window")))
    return parts


def _rectangle(low: np.ndarray, high: np.ndarray, half: np.ndarray) -> TriangleMesh:
    corners = np.array([(low[0], low[1]), (high[0], low[1]), (high[0], high[1]), (low[0], high[1])])
    uv = (corners + half) / (2 * half)
    return solids.quad(np.column_stack([corners, np.zeros(4)]), uv)


def _frame(window: WindowOpening, low: np.ndarray, high: np.ndarray) -> TriangleMesh:
    """Frame, bars between the panes and a sill, as blocks that reach through the wall's plane."""
    f = window.frame_mm * MM
    depth = 1.6 * f
    (x0, y0), (x1, y1) = low, high
    blocks = [
        ((f, y1 - y0 + 2 * f, depth), (x0 - f / 2, (y0 + y1) / 2, 0)),
        ((f, y1 - y0 + 2 * f, depth), (x1 + f / 2, (y0 + y1) / 2, 0)),
        ((x1 - x0, f, depth), ((x0 + x1) / 2, y1 + f / 2, 0)),
        ((x1 - x0, f, depth), ((x0 + x1) / 2, y0 - f / 2, 0)),
        ((x1 - x0 + 4 * f, 0.6 * f, 4 * f), ((x0 + x1) / 2, y0 - 1.3 * f, -1.5 * f)),
    ]
    bar = 0.5 * f
    for i in range(1, window.columns):
        x = x0 + (x1 - x0) * i / window.columns
        blocks.append(((bar, y1 - y0, bar), (x, (y0 + y1) / 2, 0)))
    for i in range(1, window.rows):
        y = y0 + (y1 - y0) * i / window.rows
        blocks.append(((x1 - x0, bar, bar), ((x0 + x1) / 2, y, 0)))
    return solids.join([solids.box(size, centre) for size, centre in blocks])
