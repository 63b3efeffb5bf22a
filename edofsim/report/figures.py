"""The figures of a run: depth, scores by depth, times."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import matplotlib
import torch
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from torch import Tensor

from ..restore.scores import DepthScore, Score
from .plot import (
    BLUE,
    DASHES,
    DEPTH_MAP,
    EMPTY,
    GREEN,
    HALF_IN,
    INK,
    MARKERS,
    MUTED,
    ORANGE,
    PURPLE,
    SERIES,
    Plot,
    metre_axis,
    new_figure,
)  # fmt: skip
from .words import depth_range, distance, duration, number, shorten

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLOUR_OF = {"photo": ORANGE, "restored": BLUE, "wiener": PURPLE, "lens_alone": GREEN}


@dataclass(frozen=True)
class ImageScore:
    """An image against the ideal one: as a whole, and over the pixels of each depth range."""

    whole: Score
    by_depth: tuple[DepthScore, ...] = ()


def depth_plot(inverse_depth: Tensor, focus_m: float | None = None) -> Plot:
    """The depth picture [y, x] in 1/m, bright near, with a scale in metres and in 1/m.

    inverse_depth: [y, x], 1/m.
    """
    depth = inverse_depth.detach().cpu().double()
    finite = depth[torch.isfinite(depth)]
    low, high = (float(finite.min()), float(finite.max())) if finite.numel() else (0.0, 1.0)
    seen = torch.where(torch.isfinite(depth), depth, math.nan).numpy()
    nearest, farthest = distance(_metres(high)), distance(_metres(low))
    span = f"from {nearest} to {farthest}" if nearest != farthest else f"{nearest} everywhere"
    if high - low < 1e-3:  # one depth: a scale around it
        middle = (high + low) / 2
        half = max(0.05 * middle, 0.05)
        low, high = max(0.0, middle - half), middle + half

    def paint() -> Figure:
        rows, columns = depth.shape
        figure = new_figure(HALF_IN, HALF_IN * min(rows / columns, 1.3) + 0.95)
        axes = figure.add_subplot()
        colours = matplotlib.colormaps[DEPTH_MAP].with_extremes(bad=EMPTY)
        shown = axes.imshow(seen, cmap=colours, norm=Normalize(low, high))
        axes.set_axis_off()
        bar = figure.colorbar(shown, ax=axes, orientation="horizontal", pad=0.02, aspect=32)
        bar.outline.set_visible(False)
        metre_axis(bar.ax, low, high)
        bar.ax.set_xlabel("depth (m)")
        if focus_m is not None and low <= 1 / focus_m <= high:
            bar.ax.plot(
                [1 / focus_m] * 2, [0, 1], color="white", linewidth=3, transform=bar.ax.get_xaxis_transform()
            )
            bar.ax.plot([1 / focus_m] * 2, [0, 1], color="black", linewidth=1.2,
                        transform=bar.ax.get_xaxis_transform())  # fmt: skip
        dioptres = bar.ax.secondary_xaxis("top")
        dioptres.tick_params(labelsize=8, labelcolor=MUTED)
        dioptres.set_xlabel("inverse depth (1/m)", fontsize=8, color=MUTED)
        return figure

    focus = "" if focus_m is None else f" The line on the scale marks the focus, {distance(focus_m)}."
    return Plot(
        paint,
        alt=f"Depth picture with colour scale, near bright and far dark: {span}.",
        caption=f"Depth along the optical axis, {span}. Colour follows inverse depth, "
        f"because defocus does.{focus}",
    )


def _draw_score(
    axes: Axes,
    score: ImageScore,
    limits: Callable[[DepthScore], tuple[float, float]],
    **look: Any,  # pyrefly: ignore[explicit-any] - Matplotlib's own keywords
) -> int:
    """A bar a depth range, and a line through their middles; how many there are with a finite PSNR."""
    entries = [entry for entry in score.by_depth if math.isfinite(entry.score.psnr_db)]
    values = [entry.score.psnr_db for entry in entries]
    wide = {"color": look["color"], "linewidth": 3.2, "solid_capstyle": "butt", "alpha": 0.4}
    for entry, value in zip(entries, values, strict=True):
        axes.plot(limits(entry), [value] * 2, **wide)
    axes.plot([sum(limits(entry)) / 2 for entry in entries], values, linewidth=1.3, **look)
    return len(values)


def _ranges_said(scores: Mapping[str, ImageScore], labels: Mapping[str, str]) -> list[str]:
    """The worst and the best range of each image, in words."""
    parts = []
    for name, score in scores.items():
        finite = [e for e in score.by_depth if math.isfinite(e.score.psnr_db)]
        if finite:
            worst = min(finite, key=lambda e: e.score.psnr_db)
            best = max(finite, key=lambda e: e.score.psnr_db)
            parts.append(
                f"{labels.get(name, name)}: "
                f"{number(worst.score.psnr_db)} dB ({depth_range(worst.near_m, worst.far_m)}) to "
                f"{number(best.score.psnr_db)} dB ({depth_range(best.near_m, best.far_m)})"
            )
    return parts


def score_plot(
    scores: Mapping[str, ImageScore], labels: Mapping[str, str], focus_m: float | None = None,
    nearest_m: float = 0.0,
) -> Plot:  # fmt: skip
    """PSNR over depth, one line an image. nearest_m bounds the first range, whose near end may be 0."""

    def limits(entry: DepthScore) -> tuple[float, float]:
        near = max(entry.near_m, min(nearest_m, entry.far_m))
        return (0.0 if math.isinf(entry.far_m) else 1 / entry.far_m), (
            1 / near if near > 0 else 1 / entry.far_m + 0.5
        )

    every = [limits(entry) for score in scores.values() for entry in score.by_depth]
    low, high = (min(a for a, _ in every), max(b for _, b in every)) if every else (0.0, 1.0)
    if high <= low:
        low, high = max(0.0, low - 0.05), high + 0.05

    def paint() -> Figure:
        figure = new_figure(HALF_IN, 4.1)
        axes = figure.add_subplot()
        drawn = 0
        for i, (name, score) in enumerate(scores.items()):
            colour = COLOUR_OF.get(name, SERIES[i % len(SERIES)])
            label = shorten(labels.get(name, name), 36)
            look = {"linestyle": DASHES[i % len(DASHES)], "marker": MARKERS[i % len(MARKERS)]}
            drawn += _draw_score(axes, score, limits, color=colour, label=label, **look)
        if not drawn:
            axes.text(0.5, 0.5, "no finite score", transform=axes.transAxes, ha="center", color=MUTED)
        metre_axis(axes, low, high)
        axes.set_ylabel("PSNR (dB)")
        axes.margins(y=0.15)
        if focus_m is not None and low <= 1 / focus_m <= high:
            axes.axvline(1 / focus_m, color=MUTED, linewidth=1, linestyle=(0, (2, 2)))
            axes.text(
                1 / focus_m,
                0.985,
                " focus",
                transform=axes.get_xaxis_transform(),
                color=MUTED,
                fontsize=8.5,
                va="top",
            )
        if scores:
            figure.legend(*axes.get_legend_handles_labels(), loc="outside upper left", ncols=2)
        return figure

    parts = _ranges_said(scores, labels)
    return Plot(
        paint,
        alt="PSNR by depth. " + "; ".join(parts) + "." if parts else "PSNR by depth: no finite score.",
        caption="PSNR against the ideal image over the pixels of each depth range (bars); lines guide the "
        "eye. A camera of extended depth of field shows a level line.",
    )


def time_plot(seconds: Mapping[str, float]) -> Plot:
    """Time of each stage as bars."""
    stages = [(name.replace("_", " "), float(s)) for name, s in seconds.items()]

    def paint() -> Figure:
        figure = new_figure(HALF_IN, 0.75 + 0.3 * max(len(stages), 1))
        axes = figure.add_subplot()
        lengths = [s if math.isfinite(s) else 0.0 for _, s in stages]
        axes.barh(range(len(stages)), lengths, color=BLUE, height=0.62)
        axes.set_yticks(range(len(stages)), [shorten(name, 24) for name, _ in stages])
        axes.invert_yaxis()
        axes.grid(False, axis="y")
        axes.tick_params(axis="y", length=0)
        for i, (_, s) in enumerate(stages):
            axes.annotate(
                duration(s),
                (lengths[i], i),
                xytext=(4, 0),
                textcoords="offset points",
                va="center",
                color=INK,
                fontsize=9,
            )
        axes.set_xlim(0, max([*lengths, 1e-6]) * 1.2)
        axes.set_xlabel("time (s)")
        return figure

    listed = ", ".join(f"{name} {duration(s)}" for name, s in stages)
    return Plot(paint, alt=f"Time by stage: {listed}.", caption="Wall-clock time of each stage of this run.")


def _metres(inverse_depth: float) -> float:
    return 1 / inverse_depth if inverse_depth > 0 else math.inf
