"""Figures of the experiments: one look, colours that colour-blind readers can tell, PNG."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

OKABE_ITO = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
"""M. Okabe, K. Ito, Color Universal Design (2008)."""
DASHES = ("-", "--", ":", "-.")


def new_figure(
    rows: int, columns: int, *, width: float = 3.4, height: float = 2.8
) -> tuple[Figure, list[list[Axes]]]:
    """A figure of rows x columns axes, each of `width` x `height` inches."""
    figure = Figure(figsize=(width * columns, height * rows), layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.subplots(rows, columns, squeeze=False)
    for axes in grid.flat:
        axes.grid(True, linewidth=0.4, color="0.85")
        axes.tick_params(labelsize=8)
    return figure, [list(row) for row in grid]


def without_grid(axes: Axes) -> None:
    """Make axes fit for a picture: no lines over it."""
    axes.grid(False)
    axes.set_xticks([])
    axes.set_yticks([])


def save(figure: Figure, path: Path) -> Path:
    """Write a figure as PNG, the same bytes for the same figure. Returns the path."""
    figure.savefig(path, dpi=160, metadata={"Software": None})
    return path


def write_csv(path: Path, header: Sequence[str], rows: Iterable[Sequence[Any]]) -> Path:
    """Write rows as CSV; numbers with six significant digits. Returns the path."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(header)
        writer.writerows(
            [f"{value:.6g}" if isinstance(value, float) else value for value in row] for row in rows
        )
    return path
