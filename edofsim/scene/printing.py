"""Text as an image of ink coverage, in fonts that come with matplotlib (the same on every machine)."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from ..core.shipped import installed
from ..errors import InputError

DEPTH_OF_FIELD_TEXT = (
    "Depth of field. A lens brings one distance to a sharp image; points before it and behind it are "
    "spread over a disc. How fast the disc grows is set by the aperture: a wide one gathers light and gives "
    "it back as blur. A photographer who wants the whole table sharp stops the lens down and pays with "
    "time or with noise.\n"
    "There is another way. A phase mask in the pupil spreads every point in nearly the same manner, "
    "wherever it lies. The picture on the sensor is soft everywhere, but softness that does not depend on "
    "depth can be undone by one computation for all of it. What the mask must not do is lose a spatial "
    "frequency for good: where the transfer function falls to zero, no algorithm can bring detail back.\n"
    "Colour complicates this. The refractive index of glass falls with wavelength, so red, green and blue "
    "come to focus at different distances, while a diffractive element bends red more than blue. Put "
    "together well, the two errors work against each other. Thin wires before a bright window are the hard "
    "test: each of their edges hides something behind it that a wide pupil can see.\n"
)


LONGEST_SIDE = 16384
"""Pixels beyond which a print is refused: its sides then differ by a factor of hundreds."""


def _blank(rows: float, columns: float) -> Image.Image:
    """An image without ink. Raises InputError for one too long to print."""
    if not max(rows, columns) <= LONGEST_SIDE:
        raise InputError(
            f"its print would be {columns:.4g} x {rows:.4g} pixels, more than {LONGEST_SIDE}; bring its "
            "sides closer to each other"
        )
    return Image.new("L", (round(columns), round(rows)), 0)


@lru_cache(maxsize=64)
def _font(name: str, size: int) -> ImageFont.FreeTypeFont:
    return ImageFont.truetype(installed("matplotlib") / "mpl-data" / "fonts" / "ttf" / name, size)


def _coverage(image: Image.Image) -> np.ndarray:
    return np.asarray(image, np.float32) / 255


def line_of_text(text: str, rows: int, columns: float, font: str = "DejaVuSans-Bold.ttf") -> np.ndarray:
    """One line of text in the middle of an image, as large as fits: ink coverage [row, column] in [0, 1]."""
    image = _blank(rows, columns)
    draw = ImageDraw.Draw(image)
    columns = image.width
    size = max(6, round(0.6 * rows))
    while size > 6 and draw.textlength(text, _font(font, size)) > 0.9 * columns:
        size -= 2
    draw.text((columns / 2, rows / 2), text, fill=255, font=_font(font, size), anchor="mm")
    return _coverage(image)


def page_of_text(text: str | None, lines: int, aspect: float, font: str = "DejaVuSerif.ttf") -> np.ndarray:
    """A page of text, repeated until it is full: ink coverage [y, x] in [0, 1].

    aspect: width / height of the page.

    Raises InputError where there is nothing to print.
    """
    body = DEPTH_OF_FIELD_TEXT if text is None else text
    if not body.strip():
        raise InputError("a page of text needs some text")
    pitch = 40
    rows = round(pitch * lines / 0.86)
    columns = max(64, rows * aspect)
    image = _blank(rows, columns)
    columns = image.width
    draw = ImageDraw.Draw(image)
    letters = _font(font, round(0.72 * pitch))
    margin = round(0.09 * columns)
    printed = _wrapped(draw, body, letters, columns - 2 * margin, lines)
    for i, line in enumerate(printed):
        draw.text((margin, 0.07 * rows + i * pitch), line, fill=255, font=letters)
    return _coverage(image)


def _wrapped(
    draw: ImageDraw.ImageDraw, text: str, font: ImageFont.FreeTypeFont, width: float, count: int
) -> list[str]:
    """Words in lines no longer than `width` pixels, starting over until `count` lines are full."""
    lines: list[str] = []
    while len(lines) < count:
        for paragraph in text.strip().splitlines():
            line = ""
            for word in paragraph.split():
                longer = f"{line} {word}".strip()
                if line and draw.textlength(longer, font) > width:
                    lines.append(line)
                    longer = word
                line = longer
            lines.append(line)
    return lines[:count]


def label(text: str, size: int, font: str = "DejaVuSans.ttf") -> np.ndarray:
    """A short text cut out tightly, `size` pixels high letters: ink coverage [y, x] in [0, 1]."""
    letters = _font(font, size)
    left, top, right, bottom = letters.getbbox(text)
    image = Image.new("L", (max(1, int(right - left)), max(1, int(bottom - top))), 0)
    ImageDraw.Draw(image).text((-left, -top), text, fill=255, font=letters)
    return _coverage(image)
