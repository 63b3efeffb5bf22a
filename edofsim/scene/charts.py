"""The USAF-1951 resolution chart, drawn from the geometry of MIL-STD-150A.

An element of group g and number e has 2^(g + (e - 1) / 6) line pairs a millimetre: three horizontal and
three vertical bars, each as wide as the space next to it and five times as long. Bars are kept as rectangles
and rasterised by the exact area that they cover of each texture pixel, so edges are grey where they should.
The groups are arranged as on the printed charts: an even group's elements 2 to 6 at one side and its first
below, the odd group at the other side, and in the middle the next pair, four times smaller and mirrored.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .printing import label

_WIDTH, _HEIGHT = 25.9, 24.0  # of a pair of groups, in bars of its largest element
_NEST = (11.1, 9.15)  # corner of the next, smaller pair, from the top and the side of the first group


@dataclass(frozen=True)
class Bar:
    """A black rectangle: left, bottom, width and height in millimetres; the chart's y axis points up."""

    x: float
    y: float
    width: float
    height: float


@dataclass(frozen=True)
class Label:
    """A number next to an element: left and bottom in millimetres, height of the digits, text."""

    x: float
    y: float
    size: float
    text: str


@dataclass(frozen=True)
class Chart:
    """A chart's size in millimetres and what is printed on it."""

    width: float
    height: float
    bars: tuple[Bar, ...]
    labels: tuple[Label, ...]


def line_pairs_per_mm(group: int, element: int) -> float:
    """Spatial frequency of an element, MIL-STD-150A: 2^(group + (element - 1) / 6) in line pairs a mm."""
    return 2.0 ** (group + (element - 1) / 6)


def bar_width(group: int, element: int) -> float:
    """Width of a bar in millimetres: half a line pair."""
    return 0.5 / line_pairs_per_mm(group, element)


def element_bars(x: float, top: float, width: float, mirrored: bool) -> list[Bar]:
    """One element whose upper left corner is (x, top): horizontal bars left, vertical bars right of a gap
    of two bars; `mirrored` swaps them. The element is 12 bars wide and 5 high."""
    w = width
    first, second = (7 * w, 0.0) if mirrored else (0.0, 7 * w)
    horizontal = [Bar(x + first, top - (2 * i + 1) * w, 5 * w, w) for i in range(3)]
    vertical = [Bar(x + second + 2 * i * w, top - 5 * w, w, 5 * w) for i in range(3)]
    return horizontal + vertical


def usaf_chart(first_group: int, pairs: int, border: float | None = None) -> Chart:
    """The chart from `first_group` on, with `pairs` nested pairs of groups; `border` in millimetres."""
    unit = bar_width(first_group, 1)
    edge = 4 * unit if border is None else border
    bars: list[Bar] = []
    labels: list[Label] = []
    x, top = edge, edge + _HEIGHT * unit
    for level in range(pairs):
        _pair(first_group + 2 * level, x, top, level % 2 == 1, bars, labels)
        u = bar_width(first_group + 2 * level, 1)
        # the next pair's frame is a quarter as wide; in a mirrored pair it lies as far from the right side
        inner = _WIDTH / 4
        x += u * (_NEST[0] if level % 2 == 0 else _WIDTH - _NEST[0] - inner)
        top -= u * _NEST[1]
    return Chart(_WIDTH * unit + 2 * edge, _HEIGHT * unit + 2 * edge, tuple(bars), tuple(labels))


def _pair(group: int, x: float, top: float, mirrored: bool, bars: list[Bar], labels: list[Label]) -> None:
    unit = bar_width(group, 1)

    def put(left: float, upper: float, g: int, e: int, flipped: bool) -> None:
        w = bar_width(g, e)
        size = 12 * w
        at = x + _WIDTH * unit - left - size if mirrored else x + left
        flipped ^= mirrored
        bars.extend(element_bars(at, upper, w, flipped))
        digit = 2.2 * w
        outside = at + size + 0.6 * w if flipped else at - 0.6 * w - 0.65 * digit
        labels.append(Label(outside, upper - 2.5 * w - digit / 2, digit, str(e)))

    y = top
    for e in range(2, 7):
        put(0.0, y, group, e, False)
        y -= 7 * bar_width(group, e)
    y = top
    for e in range(1, 7):
        put(_WIDTH * unit - 12 * bar_width(group + 1, e), y, group + 1, e, True)
        y -= 7 * bar_width(group + 1, e)
    put((_WIDTH - 12) * unit, top - (_HEIGHT - 5) * unit, group, 1, True)
    # a solid square, for contrast at spatial frequency zero
    side, height, left = 6.4 * unit, 7.4 * unit, 12.5 * unit
    corner = x + _WIDTH * unit - left - side if mirrored else x + left
    bars.append(Bar(corner, top - height, side, height))


def rasterise(chart: Chart, pixels_per_mm: float) -> np.ndarray:
    """Ink coverage of the chart, float32 [y, x] in [0, 1], row 0 the top; exact areas for the bars."""
    columns, rows = (max(1, round(size * pixels_per_mm)) for size in (chart.width, chart.height))
    sx, sy = columns / chart.width, rows / chart.height
    ink = np.zeros((rows, columns), np.float32)
    for bar in chart.bars:
        x0, x1 = bar.x * sx, (bar.x + bar.width) * sx
        y0, y1 = (chart.height - bar.y - bar.height) * sy, (chart.height - bar.y) * sy
        rr, r = _covered(y0, y1, rows)
        cc, c = _covered(x0, x1, columns)
        ink[rr, cc] += r[:, None] * c[None]
    for item in chart.labels:
        _print(ink, item, chart, sx, sy)
    return np.clip(ink, 0, 1)


def _covered(start: float, stop: float, count: int) -> tuple[slice, np.ndarray]:
    """Pixels that an interval touches, and how much of each it covers."""
    first, last = max(0, int(np.floor(start))), min(count, int(np.ceil(stop)))
    edges = np.arange(first, last + 1, dtype=float)
    cover = np.minimum(edges[1:], stop) - np.maximum(edges[:-1], start)
    return slice(first, last), np.clip(cover, 0, 1)


def _print(ink: np.ndarray, item: Label, chart: Chart, sx: float, sy: float) -> None:
    size = round(item.size * sy)
    if size < 5:  # digits of fewer pixels are smudges
        return
    digits = label(item.text, size)
    row = round((chart.height - item.y) * sy) - digits.shape[0]
    column = round(item.x * sx)
    area = ink[max(0, row) : row + digits.shape[0], max(0, column) : column + digits.shape[1]]
    if area.shape == digits.shape:  # a narrow border has no room for its numbers
        np.maximum(area, digits, out=area)
