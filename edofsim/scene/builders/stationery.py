"""Things on a desk: books, pencils, wires, printed pages."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from ...recipe.base import Positive, Triple
from ...recipe.placed import Placed
from ...recipe.surfaces import AnySurface, MetalSurface, PlasticSurface, Reflectance
from .. import printing, solids
from ..model import BandTexture, Surface, TriangleMesh
from ..spectra import reflectance
from ..surfaces import matt
from ..textures import flat, mixture
from .context import Builder, Context, Part

MM = 1e-3


class Book(Builder, Placed):
    """A closed book that stands upright with its front cover to the camera.

    `turn_deg = 90` shows its pages, -90 its spine; `roll_deg = 90, tilt_deg = 90` lays it on its back with
    the spine to the camera."""

    kind: Literal["book"]
    width_mm: Positive = 150.0
    """width of the cover, mm"""
    height_mm: Positive = 210.0
    """height of the cover, mm"""
    thickness_mm: Positive = 25.0
    """thickness, mm"""
    cover: AnySurface = PlasticSurface(kind="plastic", reflectance="#27476e", roughness=0.2)
    """the binding's surface"""
    front: AnySurface | None = None
    """the front cover's, if another (a photograph)"""
    title: str = ""
    """printed on the spine"""

    def build(self, context: Context) -> list[Part]:
        """A closed book about its centre: two boards, a spine on the left, pages that stand back a little."""
        w, h, t = self.width_mm * MM, self.height_mm * MM, self.thickness_mm * MM
        board = min(2.5 * MM, t / 6)
        inset = min(3 * MM, 0.05 * w, 0.05 * h)
        cover = context.surface(self.cover, "cover")
        boards = [
            solids.box((w, h, board), (0, 0, -(t - board) / 2)),
            solids.box((w, h, board), (0, 0, (t - board) / 2)),
            solids.box((board, h, t - 2 * board), (-(w - board) / 2, 0, 0)),
        ]
        pages = solids.box((w - board - inset, h - 2 * inset, t - 2 * board), ((board - inset) / 2, 0, 0))
        parts = [
            Part("", solids.join(boards), cover),
            Part("pages", pages, matt(_page_edges(context))),
        ]
        lift = 0.02 * MM  # prints lie just above the board
        if self.front is not None:
            front = solids.panel(w, h, (0, 0, -t / 2 - lift))
            parts.append(Part("front", front, context.surface(self.front, "front")))
        if self.title:
            parts.append(Part("spine", _spine(self, w, h, t, lift), _spine_surface(self, context, h / t)))
        return parts


def _page_edges(context: Context) -> BandTexture:
    """Thin stripes from sheet to sheet, of slightly different whites."""
    weight = np.repeat(context.rng("pages").uniform(0, 1, (1, 96)), 2, axis=1)
    paper = reflectance("#f3ecd8", context.wavelengths)
    return mixture(np.repeat(weight, 8, axis=0), paper, 0.72 * paper)


def _spine(recipe: Book, w: float, h: float, t: float, lift: float) -> TriangleMesh:
    x = -w / 2 - lift
    corners = [(x, -h / 2, t / 2), (x, -h / 2, -t / 2), (x, h / 2, -t / 2), (x, h / 2, t / 2)]
    # the title reads downwards, so that it is upright where the book lies on its back
    return solids.quad(corners, [(1, 0), (1, 1), (0, 1), (0, 0)])


def _spine_surface(recipe: Book, context: Context, aspect: float) -> Surface:
    ink = printing.line_of_text(recipe.title, rows=128, columns=max(128, 128 * aspect))
    cover = recipe.cover
    ground = reflectance(getattr(cover, "reflectance", 0.5), context.wavelengths)
    gold = reflectance("#e8d9a0", context.wavelengths)
    return matt(mixture(ink, ground, gold))


class Pencil(Builder, Placed):
    """A sharpened hexagonal pencil, standing on its end with the tip up.

    `tilt_deg = 90` lays it along z, tip away; `roll_deg = 90` along x."""

    kind: Literal["pencil"]
    length_mm: Positive = 175.0
    """length with the tip, mm"""
    width_mm: Positive = 7.0
    """width across the corners, mm"""
    tip_mm: Positive = 20.0
    """length of the sharpened tip, mm"""
    paint: AnySurface = PlasticSurface(kind="plastic", reflectance="orange yellow", roughness=0.12)
    """surface of the paint"""

    @model_validator(mode="after")
    def _longer_than_tip(self) -> Pencil:
        if self.tip_mm >= self.length_mm:
            raise ValueError("tip_mm must be below length_mm")
        return self

    def build(self, context: Context) -> list[Part]:
        """A hexagonal pencil along y about its centre: painted body, sharpened wood, lead."""
        length, radius, tip = self.length_mm * MM, self.width_mm / 2 * MM, self.tip_mm * MM
        flat_radius = radius * np.sqrt(3) / 2  # the cone's foot touches the middles of the hexagon's sides
        lead = 0.28 * radius
        body, neck = length - tip, tip * (1 - lead / flat_radius)
        paint = context.surface(self.paint, "paint")
        wood = matt(flat("#d9b184", context.wavelengths))
        graphite = matt(flat(0.06, context.wavelengths))
        core = 0.55 * radius
        hexagon = {"segments": 6, "smooth": False}
        shapes = [
            (
                "",
                solids.lathe([(core, 0), (radius, 0), (radius, body), (0.7 * radius, body)], **hexagon),
                paint,
            ),
            ("end", solids.lathe([(0, 0), (core, 0)], **hexagon), graphite),
            ("wood", solids.lathe([(flat_radius, body), (lead, body + neck)], 48), wood),
            ("lead", solids.lathe([(lead, body + neck), (0.15 * lead, length), (0, length)], 48), graphite),
        ]
        shapes[:2] = [(suffix, solids.flat_shaded(m), surface) for suffix, m, surface in shapes[:2]]
        return [Part(suffix, solids.moved(m, shift=(0, -length / 2, 0)), s) for suffix, m, s in shapes]


class Wire(Builder, Placed):
    """A round wire along a smooth curve through `points_mm` (local x, y, z)."""

    kind: Literal["wire"]
    points_mm: Annotated[tuple[Triple, ...], Field(min_length=2, max_length=1000)]
    """points of the smooth curve that it follows, local x, y, z, mm"""
    radius_mm: Positive = 0.25
    """radius, mm"""
    closed: bool = False
    """whether the curve returns to its first point"""
    surface: AnySurface = MetalSurface(kind="metal", metal="copper", roughness=0.2)
    """what it is made of"""
    anchor: Literal["centre", "base"] = "centre"
    """what `x`, `y` place: its origin, or the middle of its base"""

    def build(self, context: Context) -> list[Part]:
        """A tube along the cubic spline through its points."""
        path = solids.smooth_path(np.array(self.points_mm) * MM, self.closed)
        shape = solids.tube(path, self.radius_mm * MM, 12, self.closed)
        return [Part("", shape, context.surface(self.surface))]


class TextPage(Builder, Placed):
    """A page of printed text."""

    kind: Literal["text_page"]
    width_mm: Positive = 210.0
    """width, mm"""
    height_mm: Positive = 297.0
    """height, mm"""
    text: str | None = None
    """None: a text about depth of field"""
    lines: Annotated[int, Field(ge=3, le=120)] = 28
    """lines of text"""
    paper: Reflectance = 0.82
    """reflectance of the paper"""
    ink: Reflectance = 0.04
    """reflectance of the ink"""
    anchor: Literal["centre", "base"] = "centre"
    """what `x`, `y` place: its centre, or the middle of its base"""

    def build(self, context: Context) -> list[Part]:
        """A printed page: ink on paper."""
        ink = printing.page_of_text(self.text, self.lines, self.width_mm / self.height_mm)
        paper, black = (reflectance(r, context.wavelengths) for r in (self.paper, self.ink))
        shape = solids.panel(self.width_mm * MM, self.height_mm * MM)
        return [Part("", shape, matt(mixture(ink, paper, black)))]
