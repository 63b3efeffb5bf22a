"""Pages: one HTML file each, which opens without a network. A page is a title and sections of blocks.

page = Page("Sensor noise", "How much noise the restoration bears.", sections=(
    Section("Scores", (Table(columns=(Column("sigma"), Column("PSNR", "dB")), rows=((0.005, 31.2),)),)),
    Section("Pictures", (Gallery((picture(photo, "Photo", "The photo"),)),)),
))
write_page(Path("out/noise.html"), page)
"""

from __future__ import annotations

import functools
import urllib.parse
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import ClassVar, Literal, SupportsFloat, TypeGuard

import jinja2
from markupsafe import Markup

from ..core.files import write_text
from .pictures import Picture, data_uri
from .plot import Plot, darken
from .words import DASH, number

Cell = str | bool | SupportsFloat | None


@dataclass(frozen=True)
class Text:
    """A paragraph."""

    kind: ClassVar[str] = "text"
    text: str


@dataclass(frozen=True)
class Notes:
    """What a reader must not miss."""

    kind: ClassVar[str] = "notes"
    notes: tuple[str, ...]


@dataclass(frozen=True)
class Key:
    """A large number: `31.2` `dB`, what it is, and a remark."""

    label: str
    value: str
    unit: str = ""
    remark: str = ""
    strong: bool = False


@dataclass(frozen=True)
class Keys:
    """Large numbers side by side."""

    kind: ClassVar[str] = "keys"
    keys: tuple[Key, ...]


@dataclass(frozen=True)
class Values:
    """What a page's script tells of a pixel of a gallery: the light of its pictures, which were brightened
    `gain` times, and the depth there, from a picture of `depth_picture` and the inverse depth in 1/m that its
    largest code stands for."""

    gain: float
    depth: Picture
    most: float
    to_sensor: tuple[float, ...] = (1, 0, 0, 0, 1, 0, 0, 0, 1)
    """Matrix [3, 3] by rows from the pictures' linear sRGB to the sensor's colours."""


@dataclass(frozen=True)
class Gallery:
    """Pictures side by side, `columns` on a desktop and at most two on a phone; `pixels` keeps pixels square.

    `name` lets a Compare block of the same page refer to it.
    """

    kind: ClassVar[str] = "gallery"
    pictures: tuple[Picture, ...]
    caption: str = ""
    columns: int = 2
    pixels: bool = False
    name: str = ""
    title: str = ""
    values: Values | None = None


@dataclass(frozen=True)
class Sweep:
    """A slider over pictures, of which one is seen.

    label: of the slider.
    gallery: the name of the one whose values under the pointer are shown, at the same places.
    """

    kind: ClassVar[str] = "sweep"
    pictures: tuple[Picture, ...]
    label: str
    caption: str = ""
    gallery: str = ""


@dataclass(frozen=True)
class Compare:
    """A slider over two pictures of the gallery called `gallery`, chosen by the reader from all of them."""

    kind: ClassVar[str] = "compare"
    gallery: str
    left: str
    right: str
    caption: str = ""


@dataclass(frozen=True)
class Column:
    """A column of a table: name, unit, decimals of its numbers, and whether the best is marked."""

    name: str
    unit: str = ""
    digits: int = 1
    best: Literal["largest", "smallest", ""] = ""


@dataclass(frozen=True)
class Table:
    """A table. Cells are text, numbers, yes or no (bool), or None; a second line of a text is a remark.

    wordy: rows of text, which become cards on a phone.
    """

    kind: ClassVar[str] = "table"
    columns: tuple[Column, ...]
    rows: tuple[tuple[Cell, ...], ...]
    caption: str = ""
    wordy: bool = False

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.columns):
                raise ValueError(
                    f"a row of {len(row)} cells in a table of {len(self.columns)} columns: {row}"
                )

    def cells(self) -> list[list[tuple[str, str, str]]]:
        """Each cell as text, remark and CSS classes."""
        best = [self._best(i) for i in range(len(self.columns))]
        return [
            [_cell(value, column, best[i] is not None and _is_number(value) and float(value) == best[i])
             for i, (value, column) in enumerate(zip(row, self.columns, strict=True))]
            for row in self.rows
        ]  # fmt: skip

    def numeric(self, column: int) -> bool:
        """Whether a column holds numbers only, so that its head stands above them on the right."""
        return any(_is_number(r[column]) for r in self.rows) and not any(
            isinstance(r[column], str) for r in self.rows
        )

    def _best(self, column: int) -> float | None:
        choose = {"largest": max, "smallest": min}.get(self.columns[column].best)
        values = [float(cell) for cell in (row[column] for row in self.rows) if _is_number(cell)]
        values = [v for v in values if v == v]
        return choose(values) if choose and values else None


@dataclass(frozen=True)
class Pairs:
    """Names and their values."""

    kind: ClassVar[str] = "pairs"
    pairs: Mapping[str, object]
    title: str = ""
    closed: bool = False  # folded until the reader opens it; needs a title


@dataclass(frozen=True)
class Code:
    """Text to copy or read as it is, folded under its title unless `title` is empty."""

    kind: ClassVar[str] = "code"
    text: str
    title: str = ""


@dataclass(frozen=True)
class Link:
    """A card of an index page: the other page's path relative to this one, its title, and what it says."""

    href: str
    title: str
    text: str = ""
    thumbnail: Picture | None = None


@dataclass(frozen=True)
class Links:
    """Cards that lead to other pages or files."""

    kind: ClassVar[str] = "links"
    links: tuple[Link, ...]


@dataclass(frozen=True)
class SideBySide:
    """Blocks side by side on a desktop, below each other on a phone."""

    kind: ClassVar[str] = "row"
    blocks: tuple[Block, ...]


Block = Text | Notes | Keys | Gallery | Compare | Sweep | Table | Pairs | Code | Links | SideBySide | Plot


@dataclass(frozen=True)
class Section:
    """A titled part of a page; the page's menu leads to it."""

    title: str
    blocks: tuple[Block, ...]


@dataclass(frozen=True)
class Page:
    """A page: title, one sentence on what it is for, short facts, blocks at the head, and sections."""

    title: str
    purpose: str = ""
    sections: tuple[Section, ...] = ()
    head: tuple[Block, ...] = ()
    facts: Mapping[str, str] = field(default_factory=dict)
    back: Link | None = None  # where the page's index is


def page_html(page: Page) -> str:
    """The page as one HTML document; everything in it is escaped, and it loads nothing."""
    return _template().render(page=page)


def write_page(path: Path, page: Page) -> Path:
    """Write the page. Returns the path; raises what `core.files.whole` raises."""
    return write_text(path, page_html(page))


def index_page(title: str, purpose: str, links: tuple[Link, ...]) -> Page:
    """A page of cards that lead to other pages."""
    return Page(title, purpose, head=(Links(links),))


@functools.cache
def _template() -> jinja2.Template:
    folder = resources.files("edofsim.report") / "templates"
    environment = jinja2.Environment(
        loader=jinja2.FunctionLoader(lambda name: (folder / name).read_text(encoding="utf-8")),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.globals.update(
        # jinja2 has no type for its globals; the checker takes that of its own
        style=Markup((folder / "page.css").read_text(encoding="utf-8")),  # pyrefly: ignore[bad-argument-type]
        script=Markup((folder / "page.js").read_text(encoding="utf-8")),  # pyrefly: ignore[bad-argument-type]
        plot_sources=_plot_sources,  # pyrefly: ignore[bad-argument-type]
    )
    environment.filters.update(slug=_slug, href=_href, shown=_shown)
    return environment.get_template("page.html")


def _plot_sources(plot: Plot) -> dict[str, str]:
    """Data URIs of a plot for light and dark pages, wide and narrow."""
    drawn = {"wide": plot.svg()}
    if plot.paint_narrow:
        drawn["narrow"] = plot.svg(narrow=True)
    uris = {}
    for name, svg in drawn.items():
        uris[name] = data_uri(svg, "image/svg+xml")
        uris[f"{name}_dark"] = data_uri(darken(svg), "image/svg+xml")
    return uris


def _is_number(value: Cell) -> TypeGuard[SupportsFloat]:
    return value is not None and not isinstance(value, str | bool)


def _cell(value: Cell, column: Column, best: bool) -> tuple[str, str, str]:
    if isinstance(value, bool):
        return ("yes" if value else "no", "", "yes" if value else "no")
    if isinstance(value, str):
        text, _, remark = value.partition("\n")
        return text, remark, "words"
    return number(value, column.digits), "", "number best" if best else "number"


def _shown(value: object) -> str:
    """A value of a list of pairs."""
    return DASH if value is None or value == "" else str(value)


def _slug(text: str) -> str:
    return "-".join("".join(c if c.isalnum() else " " for c in text.lower()).split())


def _href(path: str) -> str:
    """A relative path as a link; whatever else it holds (a scheme, blanks) is quoted away."""
    return urllib.parse.quote(path, safe="/.#-_~")
