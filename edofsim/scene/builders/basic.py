"""Plain shapes: panel, box, sphere, cylinder, mug, goblet, prism."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from pydantic import model_validator

from ...recipe.base import Positive
from ...recipe.placed import Placed
from ...recipe.surfaces import AnySurface, GlassSurface, MattSurface, PlasticSurface
from .. import solids
from .context import Builder, Context, Part

MM = 1e-3
FINE_SEGMENTS = 96
COARSE_PX = 2.0
"""Radius of balls, in pixels, up to which fewer segments do."""


class Panel(Builder, Placed):
    """A flat rectangle: a poster, a card, a photograph."""

    kind: Literal["panel"]
    width_mm: Positive
    """width, mm"""
    height_mm: Positive
    """height, mm"""
    surface: AnySurface = MattSurface(kind="matt")
    """what it is made of; a texture covers it"""
    anchor: Literal["centre", "base"] = "centre"
    """what `x`, `y` place: its centre, or the middle of its base"""

    def build(self, context: Context) -> list[Part]:
        """A flat rectangle that faces the camera."""
        shape = solids.panel(self.width_mm * MM, self.height_mm * MM)
        return [Part("", shape, context.surface(self.surface))]


class Box(Builder, Placed):
    """A rectangular block. A texture covers each of its sides."""

    kind: Literal["box"]
    width_mm: Positive
    """size along x, mm"""
    height_mm: Positive
    """size along y, mm"""
    length_mm: Positive
    """its size along z"""
    surface: AnySurface = MattSurface(kind="matt")
    """what it is made of; a texture covers each side"""

    def build(self, context: Context) -> list[Part]:
        """A block about its centre."""
        size = np.array([self.width_mm, self.height_mm, self.length_mm]) * MM
        return [Part("", solids.box(size), context.surface(self.surface))]


def ball_segments(radius_px: float) -> int:
    """Segments around a ball of that radius in pixels.

    One of few pixels has so few that its outline is off by 0.01 of a pixel at most: thousands of such balls
    would else have millions of faces that no pixel sees."""
    if radius_px > COARSE_PX:
        return FINE_SEGMENTS
    return max(12, 2 * math.ceil(math.pi / math.sqrt(0.02 / radius_px) / 2))


class Sphere(Builder, Placed):
    """A ball."""

    kind: Literal["sphere"]
    radius_mm: Positive
    """radius, mm"""
    surface: AnySurface = PlasticSurface(kind="plastic")
    """what it is made of"""

    def build(self, context: Context) -> list[Part]:
        """A ball about its centre."""
        pixel = context.pixel_angle * self.depth_m
        # glass bends light: what is behind it shows every facet
        fine = pixel <= 0 or self.surface.kind == "glass"
        segments = FINE_SEGMENTS if fine else ball_segments(self.radius_mm * MM / pixel)
        return [Part("", solids.sphere(self.radius_mm * MM, segments), context.surface(self.surface))]


class Cylinder(Builder, Placed):
    """An upright solid cylinder."""

    kind: Literal["cylinder"]
    radius_mm: Positive
    """radius, mm"""
    height_mm: Positive
    """height, mm"""
    surface: AnySurface = PlasticSurface(kind="plastic")
    """what it is made of"""

    def build(self, context: Context) -> list[Part]:
        """A solid cylinder about its centre, its rims broken by a small chamfer, which catches the light."""
        r, h = self.radius_mm * MM, self.height_mm * MM
        c = 0.04 * min(r, h)
        profile = [(0, 0), (r - c, 0), (r, c), (r, h - c), (r - c, h), (0, h)]
        shape = solids.moved(solids.lathe(profile, 72), shift=(0, -h / 2, 0))
        return [Part("", shape, context.surface(self.surface))]


class Mug(Builder, Placed):
    """A mug with a handle, open at the top."""

    kind: Literal["mug"]
    radius_mm: Positive = 40.0
    """outer radius, mm"""
    height_mm: Positive = 95.0
    """height, mm"""
    wall_mm: Positive = 3.5
    """thickness of the wall, mm"""
    handle: bool = True
    """whether it has a handle"""
    surface: AnySurface = PlasticSurface(kind="plastic")
    """what it is made of"""

    @model_validator(mode="after")
    def _hollow(self) -> Mug:
        if self.wall_mm >= min(self.radius_mm, self.height_mm) / 2:
            raise ValueError("wall_mm must be below half of the radius and half of the height")
        return self

    def build(self, context: Context) -> list[Part]:
        """A mug with a rounded rim; its handle points to the right."""
        r, h, wall = self.radius_mm * MM, self.height_mm * MM, self.wall_mm * MM
        foot = np.linspace(-np.pi / 2, 0, 7)
        rim = np.linspace(0, np.pi, 9)
        profile = [
            (0, 0),
            *((r - wall + wall * np.cos(a), wall + wall * np.sin(a)) for a in foot),
            *((r - wall / 2 + wall / 2 * np.cos(a), h - wall / 2 + wall / 2 * np.sin(a)) for a in rim),
            *((r - 2 * wall + wall * np.cos(a), 2 * wall + wall * np.sin(a)) for a in foot[::-1]),
            (0, wall),
        ]
        surface = context.surface(self.surface)
        parts = [Part("", solids.lathe(profile, 96), surface)]
        if self.handle:
            a = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 33)
            # starts and ends inside the wall, so that no gap shows
            bow = np.stack(
                [r - wall / 2 + 0.62 * r * np.cos(a), 0.52 * h + 0.3 * h * np.sin(a), 0 * a], axis=1
            )
            parts.append(Part("handle", solids.tube(bow, 0.11 * r, 16), surface))
        return parts


class Goblet(Builder, Placed):
    """An empty stemmed glass."""

    kind: Literal["goblet"]
    radius_mm: Positive = 35.0
    """largest radius of the bowl, mm"""
    height_mm: Positive = 150.0
    """height with the stem, mm"""
    wall_mm: Positive = 2.0
    """thickness of the wall, mm"""
    surface: AnySurface = GlassSurface(kind="glass")
    """what it is made of"""

    @model_validator(mode="after")
    def _hollow(self) -> Goblet:
        if self.wall_mm >= self.radius_mm / 4:
            raise ValueError("wall_mm must be below a quarter of radius_mm")
        return self

    def build(self, context: Context) -> list[Part]:
        """A stemmed glass as one closed surface: foot, stem, bowl outside, rim, bowl inside."""
        r, h, wall = self.radius_mm * MM, self.height_mm * MM, self.wall_mm * MM
        stem, foot = max(0.1 * r, wall), 0.85 * r
        t = np.linspace(0, np.pi / 2, 14)
        bowl = 0.42 * h  # height at which the bowl begins
        outside = [(stem + (r - stem) * np.sin(a), bowl + 0.3 * h * (1 - np.cos(a))) for a in t]
        rim = np.linspace(0, np.pi, 7)
        inner = r - wall
        inside = [(inner * np.sin(a), bowl + 1.5 * wall + 0.3 * h * (1 - np.cos(a))) for a in t]
        profile = [
            (0, 0),
            (foot, 0),
            (foot, 0.5 * wall),
            *(
                (stem + (foot - stem) * (1 - np.sin(a)), 0.5 * wall + 0.06 * h * (1 - np.cos(a)))
                for a in t[1:]
            ),
            *outside,
            (0.92 * r, h - wall / 2),
            *(
                (0.92 * r - wall / 2 + wall / 2 * np.cos(a), h - wall / 2 + wall / 2 * np.sin(a))
                for a in rim[1:]
            ),
            *inside[::-1],
        ]
        shape = solids.moved(solids.lathe(profile, 128), shift=(0, -h / 2, 0))
        return [Part("", shape, context.surface(self.surface))]


class Prism(Builder, Placed):
    """A triangular prism lying along x: its sides are as long as `side_mm`."""

    kind: Literal["prism"]
    side_mm: Positive = 25.0
    """side of its triangle, mm"""
    length_mm: Positive = 60.0
    """length along x, mm"""
    surface: AnySurface = GlassSurface(kind="glass", glass="N-SF11")
    """what it is made of"""

    def build(self, context: Context) -> list[Part]:
        """An equilateral prism about its centre, lying along x on one of its faces."""
        shape = solids.prism(3, self.side_mm / np.sqrt(3) * MM, self.length_mm * MM)
        middle = solids.moved(shape, shift=(0, -self.length_mm / 2 * MM, 0))
        # the lathe's first corner looks away along +z: it becomes the edge on top, and the axis lies along x
        lying = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
        return [Part("", solids.moved(middle, lying), context.surface(self.surface))]
