"""Plain shapes: panel, box, sphere, cylinder, mug, goblet, prism."""

from __future__ import annotations

import numpy as np

from ...recipe.things import Box, Cylinder, Goblet, Mug, Panel, Prism, Sphere
from .. import solids
from .context import Context, Part

MM = 1e-3


def panel(recipe: Panel, context: Context) -> list[Part]:
    """A flat rectangle that faces the camera."""
    shape = solids.panel(recipe.width_mm * MM, recipe.height_mm * MM)
    return [Part("", shape, context.surface(recipe.surface))]


def box(recipe: Box, context: Context) -> list[Part]:
    """A block about its centre."""
    size = np.array([recipe.width_mm, recipe.height_mm, recipe.length_mm]) * MM
    return [Part("", solids.box(size), context.surface(recipe.surface))]


def sphere(recipe: Sphere, context: Context) -> list[Part]:
    """A ball about its centre."""
    return [Part("", solids.sphere(recipe.radius_mm * MM, 96), context.surface(recipe.surface))]


def cylinder(recipe: Cylinder, context: Context) -> list[Part]:
    """A solid cylinder about its centre, its rims broken by a small chamfer, which catches the light."""
    r, h = recipe.radius_mm * MM, recipe.height_mm * MM
    c = 0.04 * min(r, h)
    profile = [(0, 0), (r - c, 0), (r, c), (r, h - c), (r - c, h), (0, h)]
    shape = solids.moved(solids.lathe(profile, 72), shift=(0, -h / 2, 0))
    return [Part("", shape, context.surface(recipe.surface))]


def mug(recipe: Mug, context: Context) -> list[Part]:
    """A mug with a rounded rim; its handle points to the right."""
    r, h, wall = recipe.radius_mm * MM, recipe.height_mm * MM, recipe.wall_mm * MM
    foot = np.linspace(-np.pi / 2, 0, 7)
    rim = np.linspace(0, np.pi, 9)
    profile = [
        (0, 0),
        *((r - wall + wall * np.cos(a), wall + wall * np.sin(a)) for a in foot),
        *((r - wall / 2 + wall / 2 * np.cos(a), h - wall / 2 + wall / 2 * np.sin(a)) for a in rim),
        *((r - 2 * wall + wall * np.cos(a), 2 * wall + wall * np.sin(a)) for a in foot[::-1]),
        (0, wall),
    ]
    surface = context.surface(recipe.surface)
    parts = [Part("", solids.lathe(profile, 96), surface)]
    if recipe.handle:
        a = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 33)
        # starts and ends inside the wall, so that no gap shows
        bow = np.stack([r - wall / 2 + 0.62 * r * np.cos(a), 0.52 * h + 0.3 * h * np.sin(a), 0 * a], axis=1)
        parts.append(Part("handle", solids.tube(bow, 0.11 * r, 16), surface))
    return parts


def goblet(recipe: Goblet, context: Context) -> list[Part]:
    """A stemmed glass as one closed surface: foot, stem, bowl outside, rim, bowl inside."""
    r, h, wall = recipe.radius_mm * MM, recipe.height_mm * MM, recipe.wall_mm * MM
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
        *((stem + (foot - stem) * (1 - np.sin(a)), 0.5 * wall + 0.06 * h * (1 - np.cos(a))) for a in t[1:]),
        *outside,
        (0.92 * r, h - wall / 2),
        *((0.92 * r - wall / 2 + wall / 2 * np.cos(a), h - wall / 2 + wall / 2 * np.sin(a)) for a in rim[1:]),
        *inside[::-1],
    ]
    shape = solids.moved(solids.lathe(profile, 128), shift=(0, -h / 2, 0))
    return [Part("", shape, context.surface(recipe.surface))]


def prism(recipe: Prism, context: Context) -> list[Part]:
    """An equilateral prism about its centre, lying along x on one of its faces."""
    shape = solids.prism(3, recipe.side_mm / np.sqrt(3) * MM, recipe.length_mm * MM)
    middle = solids.moved(shape, shift=(0, -recipe.length_mm / 2 * MM, 0))
    # the lathe's first corner looks away along +z: it becomes the edge on top, and the axis lies along x
    lying = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
    return [Part("", solids.moved(middle, lying), context.surface(recipe.surface))]
