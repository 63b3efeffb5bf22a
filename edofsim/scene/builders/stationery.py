"""Things on a desk: books, pencils, wires, printed pages."""

from __future__ import annotations

import numpy as np

from ...recipe.things import Book, Pencil, TextPage, Wire
from .. import printing, solids
from ..spectra import reflectance
from ..surfaces import matt
from ..textures import flat, mixture
from .context import Context, Part

MM = 1e-3


def book(recipe: Book, context: Context) -> list[Part]:
    """A closed book about its centre: two boards, a spine on the left, and pages that stand back a little."""
    w, h, t = recipe.width_mm * MM, recipe.height_mm * MM, recipe.thickness_mm * MM
    board = min(2.5 * MM, t / 6)
    inset = min(3 * MM, 0.05 * w, 0.05 * h)
    cover = context.surface(recipe.cover, "cover")
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
    if recipe.front is not None:
        front = solids.panel(w, h, (0, 0, -t / 2 - lift))
        parts.append(Part("front", front, context.surface(recipe.front, "front")))
    if recipe.title:
        parts.append(Part("spine", _spine(recipe, w, h, t, lift), _spine_surface(recipe, context, h / t)))
    return parts


def _page_edges(context: Context):
    """Thin stripes from sheet to sheet, of slightly different whites."""
    weight = np.repeat(context.rng("pages").uniform(0, 1, (1, 96)), 2, axis=1)
    paper = reflectance("#f3ecd8", context.wavelengths)
    return mixture(np.repeat(weight, 8, axis=0), paper, 0.72 * paper)


def _spine(recipe: Book, w: float, h: float, t: float, lift: float):
    x = -w / 2 - lift
    corners = [(x, -h / 2, t / 2), (x, -h / 2, -t / 2), (x, h / 2, -t / 2), (x, h / 2, t / 2)]
    # the title reads downwards, so that it is upright where the book lies on its back
    return solids.quad(corners, [(1, 0), (1, 1), (0, 1), (0, 0)])


def _spine_surface(recipe: Book, context: Context, aspect: float):
    ink = printing.line_of_text(recipe.title, rows=128, columns=max(128, 128 * aspect))
    cover = recipe.cover
    ground = reflectance(getattr(cover, "reflectance", 0.5), context.wavelengths)
    gold = reflectance("#e8d9a0", context.wavelengths)
    return matt(mixture(ink, ground, gold))


def pencil(recipe: Pencil, context: Context) -> list[Part]:
    """A hexagonal pencil along y about its centre: painted body, sharpened wood, lead."""
    length, radius, tip = recipe.length_mm * MM, recipe.width_mm / 2 * MM, recipe.tip_mm * MM
    flat_radius = radius * np.sqrt(3) / 2  # the cone's foot touches the middles of the hexagon's sides
    lead = 0.28 * radius
    body, neck = length - tip, tip * (1 - lead / flat_radius)
    paint = context.surface(recipe.paint, "paint")
    wood = matt(flat("#d9b184", context.wavelengths))
    graphite = matt(flat(0.06, context.wavelengths))
    core = 0.55 * radius
    hexagon = {"segments": 6, "smooth": False}
    shapes = [
        ("", solids.lathe([(core, 0), (radius, 0), (radius, body), (0.7 * radius, body)], **hexagon), paint),
        ("end", solids.lathe([(0, 0), (core, 0)], **hexagon), graphite),
        ("wood", solids.lathe([(flat_radius, body), (lead, body + neck)], 48), wood),
        ("lead", solids.lathe([(lead, body + neck), (0.15 * lead, length), (0, length)], 48), graphite),
    ]
    shapes[:2] = [(suffix, solids.flat_shaded(m), surface) for suffix, m, surface in shapes[:2]]
    return [Part(suffix, solids.moved(m, shift=(0, -length / 2, 0)), s) for suffix, m, s in shapes]


def wire(recipe: Wire, context: Context) -> list[Part]:
    """A tube along the cubic spline through the recipe's points."""
    path = solids.smooth_path(np.array(recipe.points_mm) * MM, recipe.closed)
    shape = solids.tube(path, recipe.radius_mm * MM, 12, recipe.closed)
    return [Part("", shape, context.surface(recipe.surface))]


def text_page(recipe: TextPage, context: Context) -> list[Part]:
    """A printed page: ink on paper."""
    ink = printing.page_of_text(recipe.text, recipe.lines, recipe.width_mm / recipe.height_mm)
    paper, black = (reflectance(r, context.wavelengths) for r in (recipe.paper, recipe.ink))
    shape = solids.panel(recipe.width_mm * MM, recipe.height_mm * MM)
    return [Part("", shape, matt(mixture(ink, paper, black)))]
