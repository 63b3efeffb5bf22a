"""The index over all experiments that are found in a folder."""

from __future__ import annotations

import base64
import io
import re
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
from PIL import Image

from ..core.images import png_bytes
from ..errors import InputError
from .page import Link, Page, index_page, write_page
from .pictures import Picture
from .words import listed

INDEX = "index.html"
THUMBNAIL_PX = 280
FEW_KEYS = 3
_PICTURE = re.compile(r'<img src="data:image/png;base64,([A-Za-z0-9+/=]+)"')


def write_index(folder: Path) -> Path:
    """Write FOLDER/index.html with a card for each page in the folders inside it. Returns the path.

    Raises InputError where there is no page.
    """
    pages = sorted(path for path in folder.glob("*/*.html") if path.name != INDEX)
    links = [link for path in pages if (link := _card(path, folder)) is not None]
    if not links:
        raise InputError(
            f"{folder}: no pages of experiments in its folders; run some of them, then this again"
        )
    return write_page(folder / INDEX, _page(tuple(links)))


def _page(links: tuple[Link, ...]) -> Page:
    purpose = f"{len(links)} pages, newest figures of each: open one for its pictures, curves and tables."
    return index_page("Experiments", purpose, links)


def _card(path: Path, folder: Path) -> Link | None:
    """The card of one of our pages; None for other HTML."""
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return None
    if '<meta name="generator" content="edofsim">' not in text:
        return None
    reader = _Reader()
    reader.feed(re.sub(r'"data:[^"]*"', '""', text))
    facts = listed([" ".join(key.split()) for key in reader.keys[:FEW_KEYS]])
    said = f"{reader.purpose} Figures: {facts}." if facts else reader.purpose
    where = path.relative_to(folder).as_posix()
    return Link(where, reader.title or path.stem, said, _thumbnail(path, text, reader.title))


def _thumbnail(path: Path, text: str, title: str) -> Picture | None:
    """The middle of the page's last picture, which is what came out; else all of the plot next to it."""
    found = _PICTURE.findall(text)
    stored = path.with_suffix(".png")
    if not found and not stored.is_file():
        return None
    try:
        content = base64.b64decode(found[-1]) if found else stored.read_bytes()
        with Image.open(io.BytesIO(content)) as image:
            picture = image.convert("RGB")
    except (OSError, SyntaxError, ValueError):
        return None
    if found:
        side = min(picture.size)
        left, top = (picture.width - side) // 2, (picture.height - side * 9 // 16) // 2
        picture = picture.crop((left, top, left + side, top + side * 9 // 16))
    picture.thumbnail((THUMBNAIL_PX, THUMBNAIL_PX))
    return Picture(
        png_bytes(np.asarray(picture)), picture.width, picture.height, title, f"A picture of: {title}."
    )


class _Reader(HTMLParser):
    """Title, purpose and large numbers of a page."""

    def __init__(self) -> None:
        super().__init__()
        self.title = self.purpose = ""
        self.keys: list[str] = []
        self._inside = ""
        self._in_keys = False

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        kind = dict(attrs).get("class") or ""
        if tag == "dl":
            self._in_keys = kind == "keys"
        if tag == "h1" or (tag == "p" and kind == "purpose"):
            self._inside = "title" if tag == "h1" else "purpose"
        elif self._in_keys and tag in ("dt", "b") or (self._in_keys and tag == "span"):
            self._inside = "key" if tag == "dt" else "value"
            if tag == "dt":
                self.keys.append("")

    def handle_endtag(self, tag: str) -> None:
        if tag in ("h1", "p", "dt", "b", "span"):
            self._inside = ""
        if tag == "dl":
            self._in_keys = False

    def handle_data(self, data: str) -> None:
        if self._inside == "title":
            self.title += data.strip()
        elif self._inside == "purpose":
            self.purpose += data.strip()
        elif self._inside in ("key", "value") and self.keys:
            self.keys[-1] += f" {data.strip()}"
