"""A corridor: five slanted planes, doors along the sides, and panels in the ceiling that shine."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from ...recipe.base import NotNegative, Positive
from ...recipe.surfaces import AnySurface, CheckerTexture, MattSurface, PhotoTexture, PlasticSurface
from .. import solids
from ..model import TriangleMesh
from ..spectra import illuminant
from ..surfaces import matt
from ..textures import flat
from .context import Builder, Context, Part

MM = 1e-3


class Hallway(Builder):
    """A corridor towards its end wall: floor, ceiling and side walls that slant through all depths.

    Doors stand along both sides, and panels in the ceiling shine. `y_mm` is the floor's height. The floor's
    texture is laid in tiles as wide as the corridor and four times as long."""

    kind: Literal["hallway"]
    near_m: Positive = 0.45
    """distance of its near end, m"""
    far_m: float = 5.0
    """distance of its end wall, m"""
    x_mm: float = 0.0
    """its middle to the right of the axis, mm"""
    y_mm: float = -30.0
    """height of the floor, mm; negative lies below the axis"""
    width_mm: Positive = 80.0
    """width, mm"""
    height_mm: Positive = 66.0
    """height, mm"""
    doors: Annotated[int, Field(ge=0, le=40)] = 5
    """doors along each side"""
    lamps: Annotated[int, Field(ge=0, le=40)] = 6
    """shining panels in the ceiling"""
    lamp_radiance: NotNegative = 4.0
    """radiance of the panels, W/m2/sr/nm"""
    lamp_illuminant: str = "LED-B3"
    """spectrum of the panels: a CIE illuminant"""
    floor: AnySurface = MattSurface(
        kind="matt", texture=CheckerTexture(kind="checker", first=0.12, second=0.6, columns=4, rows=4)
    )
    """surface of the floor"""
    walls: AnySurface = MattSurface(kind="matt", reflectance="#e2d5b8")
    """surface of the side walls"""
    ceiling: AnySurface = MattSurface(kind="matt", reflectance=0.8)
    """surface of the ceiling"""
    end: AnySurface = MattSurface(kind="matt", texture=PhotoTexture(kind="photo", name="coffee"))
    """surface of the end wall"""
    door: AnySurface = PlasticSurface(kind="plastic", reflectance="#7b4a2d", roughness=0.2)
    """surface of the doors"""

    @model_validator(mode="after")
    def _ordered(self) -> Hallway:
        if self.far_m <= self.near_m:
            raise ValueError("far_m must be above near_m")
        return self

    def build(self, context: Context) -> list[Part]:
        """The corridor in camera space but for x_mm and y_mm: its floor lies at y = 0."""
        w, h = self.width_mm / 2 * MM, self.height_mm * MM
        near, far = self.near_m, self.far_m
        tiles = (far - near) / (8 * w)
        floor = solids.quad(
            [(-w, 0, near), (w, 0, near), (w, 0, far), (-w, 0, far)], [(0, 0), (1, 0), (1, tiles), (0, tiles)]
        )
        ceiling = solids.quad([(-w, h, far), (w, h, far), (w, h, near), (-w, h, near)])
        left = solids.quad([(-w, 0, near), (-w, 0, far), (-w, h, far), (-w, h, near)], _tiled(tiles))
        right = solids.quad([(w, 0, far), (w, 0, near), (w, h, near), (w, h, far)], _tiled(tiles))
        parts = [
            Part("floor", floor, context.surface(self.floor, "floor")),
            Part("ceiling", ceiling, context.surface(self.ceiling, "ceiling")),
            Part("walls", solids.join([left, right]), context.surface(self.walls, "walls")),
            Part("end", solids.panel(2 * w, h, (0, h / 2, far)), context.surface(self.end, "end")),
        ]
        if self.doors:
            parts.append(Part("doors", _doors(self, w, h), context.surface(self.door, "door")))
        shine = self.lamp_radiance * illuminant(self.lamp_illuminant, context.wavelengths)
        black = matt(flat(0.0, context.wavelengths))
        for number, lamp in enumerate(_lamps(self, w, h), start=1):
            # one object each, so that a light is chosen as often far away, where lamps are long, as nearby
            parts.append(Part(f"lamp {number}", lamp, black, shine.astype(np.float32)))
        return parts

    def origin(self) -> tuple[float, float, float]:
        return self.x_mm * MM, self.y_mm * MM, 0.0


def _tiled(tiles: float) -> list[tuple[float, float]]:
    return [(0, 0), (tiles, 0), (tiles, 1), (0, 1)]


def _spread(count: int, near: float, far: float) -> np.ndarray:
    """Depths that look evenly spaced: even in the middle between depth and its inverse."""
    t = (np.arange(count) + 0.5) / count
    return np.exp(np.log(near) + t * np.log(far / near))


def _doors(recipe: Hallway, w: float, h: float) -> TriangleMesh:
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
