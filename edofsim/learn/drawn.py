"""Sheets of bars, rings, boards and letters as training data, drawn at random, as planes at one depth.

Photographs have few edges from black to white that are as fine as the sensor sees; charts and print have
little else.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import Annotated, Literal, TypeAlias

import numpy as np
import torch
from PIL import Image, ImageDraw, ImageFont
from pydantic import Field
from torch import Tensor

from .photographs import Photographs, PlaneSource, plane_source
from .reader import Wanted
from .sources import Images

SIDE = 512  # pixels of a sheet
FINER = 3  # drawn in pixels this many times smaller, then averaged
ITEMS = 60  # on a sheet
DARK, LIGHT = 0, 160  # least values of 255 of dark and of light ink
Ink: TypeAlias = tuple[int, int, int]
LETTERS = "ABCDEFGHJKLMNPRSTUVXYZ0123456789"


class DrawnSheets(Photographs):
    """Sheets of bars, rings, boards, discs and letters, dark on light or light on dark, half of them grey,
    drawn from the recipe's seed: charts and print, of which photographs hold little."""

    kind: Literal["drawn"] = "drawn"
    sheets: Annotated[int, Field(ge=2)] = 80
    """sheets that are drawn"""

    def open(self, wanted: Wanted) -> PlaneSource:
        images = drawn(self.sheets, wanted.recipe.seed, max(SIDE, wanted.recipe.data.patch_px))
        return plane_source(self, images, "sheets", wanted.recipe, wanted.optics.window)


def drawn(count: int, seed: int, side: int = SIDE) -> Images:
    """`count` sheets of side x side pixels; the same seed draws the same."""
    sheets = tuple(_sheet(np.random.default_rng([seed, index]), side) for index in range(count))
    digest = hashlib.sha256()
    for sheet in sheets:
        digest.update(sheet.numpy().tobytes())
    return Images(sheets, tuple(f"sheet {index}" for index in range(count)), digest.hexdigest())


@dataclass(frozen=True)
class Pen:
    """What one thing is drawn with.

    place: x and y of its corner or middle.
    stroke: its finest width, in pixels of the drawing.
    ink, paper: red, green, blue of 255.
    """

    draw: ImageDraw.ImageDraw
    random: np.random.Generator
    place: tuple[float, float]
    stroke: float
    ink: Ink
    paper: Ink

    def box(self, x: float, y: float, width: float, height: float, ink: Ink | None = None) -> None:
        """A filled rectangle whose corner is (x, y) from the place."""
        left, top = self.place[0] + x, self.place[1] + y
        self.draw.rectangle((left, top, left + width, top + height), fill=self.ink if ink is None else ink)


def _sheet(random: np.random.Generator, side: int) -> Tensor:
    """uint8 [3, side, side]."""
    coloured = random.random() < 0.5
    dark, light = (_ink(random, low, coloured) for low in (DARK, LIGHT))
    paper, ink = (light, dark) if random.random() < 0.6 else (dark, light)
    image = Image.new("RGB", (side * FINER, side * FINER), paper)
    draw = ImageDraw.Draw(image)
    kinds = (_bars, _bars, _bars, _rings, _chequers, _filled, _letters)
    for _ in range(round(ITEMS * (side / SIDE) ** 2)):
        stroke = FINER * 1.5 * 16 ** float(random.random())  # 1.5 to 24 pixels, finer ones as often as coarse
        x, y = (float(value) for value in random.random(2) * side * FINER)
        other = _ink(random, DARK if random.random() < 0.5 else LIGHT, True)
        colour = other if coloured and random.random() < 0.3 else ink
        kinds[random.integers(len(kinds))](Pen(draw, random, (x, y), stroke, colour, paper))
    small = image.resize((side, side), Image.Resampling.BOX)
    return torch.from_numpy(np.array(small)).permute(2, 0, 1).contiguous()


def _ink(random: np.random.Generator, low: int, coloured: bool) -> Ink:
    """Three colours of their own between `low` and 95 above it, or a grey, half of them black or white."""
    if coloured:
        red, green, blue = (int(value) for value in random.integers(low, low + 96, 3))
        return red, green, blue
    end = 0 if low == DARK else 255
    grey = end if random.random() < 0.5 else int(random.integers(low, low + 96))
    return grey, grey, grey


def _bars(pen: Pen) -> None:
    """Bars and gaps alike, across or upright, cleared around."""
    count, length = int(pen.random.integers(2, 7)), pen.stroke * pen.random.uniform(3, 12)
    across = pen.stroke * (2 * count - 1)
    upright = pen.random.random() < 0.5
    wide, high = (across, length) if upright else (length, across)
    pen.box(-pen.stroke, -pen.stroke, wide + 2 * pen.stroke, high + 2 * pen.stroke, pen.paper)
    for index in range(count):
        at = 2 * pen.stroke * index
        pen.box(*((at, 0, pen.stroke, length) if upright else (0, at, length, pen.stroke)))


def _rings(pen: Pen) -> None:
    x, y = pen.place
    for index in range(int(pen.random.integers(2, 6)) * 2, 0, -1):
        radius = pen.stroke * index
        fill = pen.ink if index % 2 else pen.paper
        pen.draw.ellipse((x - radius, y - radius, x + radius, y + radius), fill=fill)


def _chequers(pen: Pen) -> None:
    cells = int(pen.random.integers(3, 9))
    pen.box(0, 0, cells * pen.stroke, cells * pen.stroke, pen.paper)
    for column in range(cells):
        for row in range(1 - column % 2, cells, 2):
            pen.box(column * pen.stroke, row * pen.stroke, pen.stroke, pen.stroke)


def _filled(pen: Pen) -> None:
    """An ellipse or a rectangle."""
    x, y = pen.place
    wide, high = (pen.stroke * float(size) for size in pen.random.uniform(2, 8, 2))
    shape = pen.draw.ellipse if pen.random.random() < 0.5 else pen.draw.rectangle
    shape((x, y, x + wide, y + high), fill=pen.ink)


def _letters(pen: Pen) -> None:
    """A line of them, strokes about a seventh of their height."""
    text = "".join(pen.random.choice(list(LETTERS), int(pen.random.integers(2, 16))))
    pen.draw.text(pen.place, text, fill=pen.ink, font=ImageFont.load_default(size=7 * pen.stroke))
