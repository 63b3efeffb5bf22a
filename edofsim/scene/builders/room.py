"""What stands around the objects: table-top, wall with a window."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from ...recipe.base import NotNegative, Positive, RecipeModel
from ...recipe.surfaces import AnySurface, MattSurface, PlasticSurface, WoodTexture
from .. import solids
from ..model import TriangleMesh
from .context import Builder, Context, Part

MM = 1e-3


class Table(Builder):
    """A horizontal table-top from `near_m` to `far_m`; its top lies at `y_mm`.

    The texture is laid in tiles of `tile_mm` (across, along the depth)."""

    kind: Literal["table"]
    y_mm: float
    """height of the table-top, mm; negative lies below the axis"""
    near_m: float
    """distance of its near edge, m"""
    far_m: float
    """distance of its far edge, m"""
    width_mm: Positive = 1200.0
    """width, mm"""
    thickness_mm: Positive = 20.0
    """thickness of the table-top, mm"""
    tile_mm: tuple[Positive, Positive] = (90.0, 700.0)
    """size of a tile of the texture, across and along the depth, mm"""
    surface: AnySurface = PlasticSurface(kind="plastic", texture=WoodTexture(kind="wood"), roughness=0.25)
    """what it is made of"""

    @model_validator(mode="after")
    def _ordered(self) -> Table:
        if self.far_m <= self.near_m:
            raise ValueError("far_m must be above near_m")
        return self

    def build(self, context: Context) -> list[Part]:
        """A slab whose top lies at y = 0, from near_m to far_m: in camera space but for its height."""
        w, t = self.width_mm * MM, self.thickness_mm * MM
        near, far = self.near_m, self.far_m
        across, along = (size * MM for size in self.tile_mm)
        slab = solids.box((w, t, far - near), (0, -t / 2, (near + far) / 2))
        # texture tiles: x and depth, and on the sides depth and height
        x, y, z = slab.vertices.astype(float).T
        uv = np.stack([x / across, (z - near - y) / along], axis=1)
        return [
            Part("", solids.mesh(slab.vertices, slab.faces, uv), context.surface(self.surface)),
        ]

    def origin(self) -> tuple[float, float, float]:
        return 0.0, self.y_mm * MM, 0.0


class WindowOpening(RecipeModel):
    """A window in a wall: centre and size in the wall, the width of its frame, and its panes."""

    x_mm: float
    """centre to the right of the wall's, mm"""
    y_mm: float
    """centre above the wall's, mm"""
    width_mm: Positive
    """width, mm"""
    height_mm: Positive
    """height, mm"""
    frame_mm: NotNegative = 10.0
    """width of the frame, mm"""
    columns: Annotated[int, Field(ge=1, le=16)] = 1
    """panes across"""
    rows: Annotated[int, Field(ge=1, le=16)] = 1
    """panes up"""
    surface: AnySurface = PlasticSurface(kind="plastic", reflectance=0.8, roughness=0.2)
    """surface of the frame"""


class Wall(Builder):
    """A wall across the view at `depth_m`, with at most one window."""

    kind: Literal["wall"]
    depth_m: float
    """distance from the lens along the axis, m"""
    x_mm: float = 0.0
    """centre to the right of the axis, mm"""
    y_mm: float = 0.0
    """centre above the axis, mm"""
    width_mm: Positive = 3000.0
    """width, mm"""
    height_mm: Positive = 2000.0
    """height, mm"""
    window: WindowOpening | None = None
    """a window in it"""
    surface: AnySurface = MattSurface(kind="matt", reflectance=0.6)
    """what it is made of"""

    @model_validator(mode="after")
    def _window_in_wall(self) -> Wall:
        w = self.window
        if w is None:
            return self
        inside_x = abs(w.x_mm) + w.width_mm / 2 < self.width_mm / 2
        inside_y = abs(w.y_mm) + w.height_mm / 2 < self.height_mm / 2
        if not (inside_x and inside_y):
            raise ValueError("the window must lie inside the wall (x_mm and y_mm start at the wall's centre)")
        return self

    def build(self, context: Context) -> list[Part]:
        """A wall about its centre, with a window's opening, frame and bars where the recipe has one."""
        half = np.array([self.width_mm, self.height_mm]) / 2 * MM
        surface = context.surface(self.surface)
        if self.window is None:
            return [Part("", solids.panel(*(2 * half)), surface)]
        window = self.window
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

    def origin(self) -> tuple[float, float, float]:
        return self.x_mm * MM, self.y_mm * MM, self.depth_m


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
