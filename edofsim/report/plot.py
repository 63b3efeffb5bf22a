"""Plots in one style: drawn once, shown on light and dark pages, wide and narrow, or saved as a file.

Colours are those of Okabe and Ito and the maps cividis and magma, which colour-blind people can read; lines
differ in marker or dash as well.
"""

from __future__ import annotations

import functools
import io
import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Literal

import matplotlib
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

from ..core.files import write_bytes
from ..errors import InputError
from .words import metres

TITLE_PT = 9
INK, MUTED, GRID, EMPTY = "#1d232b", "#5a6572", "#d5dae1", "#b9bec6"
BLUE, ORANGE, GREEN, PURPLE, YELLOW = "#0072b2", "#d55e00", "#007f5f", "#a8507f", "#8a6d00"
SERIES = (BLUE, ORANGE, GREEN, PURPLE, YELLOW)
MARKERS = ("o", "s", "^", "D", "v")
DASHES = ("-", (0, (5, 1.6)), (0, (1.2, 1.4)), (0, (7, 1.6, 1.2, 1.6)), (0, (3, 1, 1, 1, 1, 1)))
DARK = {  # the same colours on a dark page: plots are drawn light, and recoloured
    INK: "#e4e7eb", MUTED: "#a2acb8", GRID: "#39414b", EMPTY: "#59616c",
    BLUE: "#56b4e9", ORANGE: "#ff9142", GREEN: "#36c99b", PURPLE: "#e39ac2", YELLOW: "#f0c340",
}  # fmt: skip
DEPTH_MAP, LIGHT_MAP = "cividis", "magma"

FINE_DIGITS = (1.1, 1.3, 1.4, 1.6, 1.7, 1.8, 1.9, 2.5, 3.5, 4.5, 9)  # of metres, where there is room

WIDE_IN, HALF_IN, NARROW_IN = 10.6, 4.6, 3.75  # widths of a full column, of half, and of a phone

STYLE = {
    "font.family": "DejaVu Sans",  # comes with matplotlib: the same picture on every machine
    "font.size": 9,
    "axes.titlesize": TITLE_PT,
    "axes.titleweight": "bold",
    "axes.labelsize": 9,
    "xtick.labelsize": 8.5,
    "ytick.labelsize": 8.5,
    "legend.fontsize": 8.5,
    "legend.frameon": False,
    "text.color": INK,
    "axes.labelcolor": INK,
    "axes.titlecolor": INK,
    "axes.edgecolor": MUTED,
    "axes.linewidth": 0.8,
    "axes.facecolor": "none",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": GRID,
    "grid.linewidth": 0.7,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "lines.linewidth": 1.8,
    "lines.markersize": 5.5,
    "figure.facecolor": "none",
    "figure.constrained_layout.use": True,
    "image.interpolation": "none",
    "image.composite_image": False,
    "svg.fonttype": "path",
    "svg.hashsalt": "edofsim",  # the same plot gives the same bytes
}


@dataclass(frozen=True)
class Plot:
    """A plot of a page. `paint` draws it; `paint_narrow`, where given, draws it for a phone.

    caption stands below it, and alt is read out instead of it.
    """

    kind: ClassVar[str] = "plot"
    paint: Callable[[], Figure]
    alt: str
    caption: str
    paint_narrow: Callable[[], Figure] | None = None

    def svg(self, *, narrow: bool = False) -> str:
        """The plot on a transparent ground, in the colours of a light page."""
        with matplotlib.rc_context(STYLE):
            figure = self.paint_narrow() if narrow and self.paint_narrow else self.paint()
            buffer = io.StringIO()
            FigureCanvasSVG(figure).print_svg(buffer, metadata={"Date": None, "Creator": None})
        return buffer.getvalue()

    def png(self, *, dpi: float = 150) -> bytes:
        """The plot on white."""
        with matplotlib.rc_context(STYLE):
            figure = self.paint()
            figure.set_facecolor("white")
            figure.set_dpi(dpi)
            buffer = io.BytesIO()
            FigureCanvasAgg(figure).print_png(buffer, metadata={"Software": None})
        return buffer.getvalue()

    def save(self, path: Path) -> Path:
        """Write it as .png or .svg, as the name says. Raises InputError for another ending, and what
        `core.files.whole` raises."""
        if path.suffix.lower() not in (".png", ".svg"):
            raise InputError(f"{path}: plots are written as .png or .svg; name such a file")
        content = self.png() if path.suffix.lower() == ".png" else self.svg().encode()
        return write_bytes(path, content)


def darken(svg: str) -> str:
    """A plot's SVG in the colours of a dark page."""
    return re.sub("|".join(DARK), lambda found: DARK[found.group()], svg)


def new_figure(width: float, height: float, layout: Literal["constrained", "none"] = "constrained") -> Figure:
    """An empty figure of a size in inches, outside matplotlib's global state."""
    # matplotlib takes "none" too; its stubs do not know
    return Figure(figsize=(width, height), layout=layout)  # pyrefly: ignore[bad-argument-type]


def picture_axes(*every: Axes) -> None:
    """Make axes fit for pictures: no lines, ticks or frames."""
    for axes in every:
        axes.grid(False)
        axes.set_xticks([])
        axes.set_yticks([])
        axes.spines[:].set_visible(False)


def metre_ticks(low: float, high: float, count: int = 9) -> list[float]:
    """Inverse depths in 1/m, ascending, that have short names in metres, spread over [low, high].

    Infinity (0) first where it is inside, then the rounder of the metres; none nearer to another than the
    range divided by `count`. Where no such name falls inside, the middle.
    """
    gap = (high - low) / count
    chosen: list[float] = [0.0] if low <= 0 <= high else []
    decades = [10.0**e for e in range(-3, 4)]
    for digits in ((1,), (2, 5), (3, 1.5, 7), (1.2, 4, 6, 8), FINE_DIGITS):
        if digits is FINE_DIGITS and len(chosen) >= 4:
            break
        for z in (digit * decade for decade in decades for digit in digits):
            if low <= 1 / z <= high and all(abs(1 / z - other) >= gap for other in chosen):
                chosen.append(1 / z)
    return sorted(chosen) or [(low + high) / 2]


def metre_axis(axes: Axes, low: float, high: float, count: int = 9) -> None:
    """Label an x axis of inverse depth in metres, near on the left."""
    ticks = metre_ticks(low, high, count)
    axes.set_xticks(ticks, [_short(t) for t in ticks])
    axes.set_xlim(high, low)
    axes.set_xlabel("depth (m), even steps in 1/m")


def _short(inverse_depth: float) -> str:
    if inverse_depth <= 0:
        return "∞"
    z = 1 / inverse_depth
    return f"{z:.3g}" if z < 1000 else metres(z)


def spread(count: int, most: int) -> list[int]:
    """At most `most` indices out of `count`, evenly spread, both ends among them."""
    if count <= most:
        return list(range(count))
    return [round(i * (count - 1) / (most - 1)) for i in range(most)]


def line_plot(
    series: Sequence[tuple[str, Sequence[float], Sequence[float]]],
    *,
    x: str,
    y: str,
    alt: str,
    caption: str,
    log_x: bool = False,
    log_y: bool = False,
    width: float = HALF_IN,
) -> Plot:
    """Lines (name, x values, y values) with named axes; x and y carry their units, `frequency (cycles/mm)`.

    Points that are not finite are left out.
    """

    def paint(inches: float = width) -> Figure:
        figure = new_figure(inches, 3.2)
        axes = figure.add_subplot()
        for i, (name, xs, ys) in enumerate(series):
            points = [
                (float(a), float(b))
                for a, b in zip(xs, ys, strict=True)
                if math.isfinite(a) and math.isfinite(b)
            ]
            axes.plot(
                [a for a, _ in points], [b for _, b in points],
                color=SERIES[i % len(SERIES)], linestyle=DASHES[i % len(DASHES)],
                marker=MARKERS[i % len(MARKERS)] if len(points) <= 24 else None, label=name,
            )  # fmt: skip
        if log_x:
            axes.set_xscale("log")
        if log_y:
            axes.set_yscale("log")
        if inches == NARROW_IN and not log_x:
            axes.locator_params(axis="x", nbins=5)
        axes.set_xlabel(x)
        axes.set_ylabel(y)
        if len(series) > 1:
            axes.legend()
        return figure

    return Plot(paint, alt, caption, functools.partial(paint, NARROW_IN) if width > HALF_IN else None)
