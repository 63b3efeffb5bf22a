"""Charts and page of `edofsim cost`: error against seconds for the photo, and for each stage around it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from ..report.page import Block, Column, Key, Keys, Page, Section, Table, Text, write_page
from ..report.plot import BLUE, GREEN, INK, MUTED, NARROW_IN, ORANGE, WIDE_IN, Plot, new_figure
from . import cost, cost_stages
from .cost import Measured, pareto

LABEL_PLACES = (
    (7, 0, "left", "center"), (-7, 0, "right", "center"), (0, 6, "center", "bottom"),
    (0, -6, "center", "top"), (5, 4, "left", "bottom"), (5, -4, "left", "top"),
    (-5, 4, "right", "bottom"), (-5, -4, "right", "top"), (8, 13, "left", "bottom"),
    (8, -13, "left", "top"), (-8, 13, "right", "bottom"), (-8, -13, "right", "top"),
    (0, 18, "center", "bottom"), (0, -18, "center", "top"),
)  # fmt: skip
"""Where the name of a point may stand: across and up in points, and which side of it is there."""
SHIFTS = (
    "How far the PSNR of the restored photo, and its gain over the lens alone, lie from those of everything "
    "in full with the same noise; next to it, the standard deviation of the score itself over seeds of noise."
)


def cost_plot(rows: Sequence[Measured], scene: str, width: float = WIDE_IN) -> Plot:
    """The chart of `edofsim cost`, `width` inches wide: seconds of a photo across, accuracy upwards."""
    rows = [row for row in rows if math.isfinite(row.measured_db) and row.seconds > 0]
    targets = [row for row in rows if row.case.kind == "target"]
    without = sorted((row for row in rows if row.case.kind == "without"), key=lambda row: row.measured_db)
    chosen = [row for row in rows if row.case.kind == "chosen"]
    front = pareto([*targets, *chosen])

    def paint(inches: float = width) -> Figure:
        figure = new_figure(inches, 4.2)
        axes = figure.add_subplot()
        axes.plot(
            [row.seconds for row in front], [row.measured_db for row in front],
            color=BLUE, linestyle="-", marker="o", label="planned, by target (Pareto front)",
        )  # fmt: skip
        behind = [row for row in targets if row not in front]
        axes.plot(
            [row.seconds for row in behind], [row.measured_db for row in behind],
            color=MUTED, linestyle="", marker="o", label="planned, beaten by another",
        )  # fmt: skip
        axes.plot(
            [row.seconds for row in without], [row.measured_db for row in without],
            color=ORANGE, linestyle="", marker="x", label="an effect left out",
        )  # fmt: skip
        axes.plot(
            [row.seconds for row in chosen], [row.measured_db for row in chosen],
            color=GREEN, linestyle="", marker="*", markersize=14, label="chosen by default",
        )  # fmt: skip
        axes.set_xscale("log")
        axes.xaxis.set_major_formatter("{x:g}")
        few_ticks(axes.xaxis, [row.seconds for row in rows])
        axes.set_xlabel("seconds of a photo")
        axes.set_ylabel("PSNR against the full simulation (dB)")
        axes.legend(loc="best")
        name_points(axes, [(row.seconds, row.measured_db, row.case.name) for row in without])
        return figure

    best = f"{chosen[0].measured_db:.1f} dB in {chosen[0].seconds:.2g} s" if chosen else "none"
    return Plot(
        paint,
        alt=f"Accuracy against seconds for {scene}. Chosen: {best}.",
        caption=f"What accuracy costs for {scene}: PSNR of the noise-free photo against the full simulation. "
        "Crosses: one effect left out of a plan for 60 dB.",
        paint_narrow=lambda: paint(NARROW_IN),
    )


def name_points(axes: Axes, points: Sequence[tuple[float, float, str]]) -> None:
    """Write the name of each point (x, y, name) where it covers the least of the lines and markers
    of these axes and of other names. Limits, scales and the legend must be there already."""
    figure = axes.get_figure(root=True)
    assert figure is not None
    figure.draw_without_rendering()
    lines = [axes.transData.transform(np.asarray(line.get_xydata())) for line in axes.lines]
    ways = [np.linspace(a, b, 24) for xy, line in zip(lines, axes.lines, strict=True)
            if line.get_linestyle() not in ("None", "") for a, b in pairwise(xy)]  # fmt: skip
    drawn = np.concatenate([np.zeros((0, 2)), *lines, *ways])
    legend = axes.get_legend()
    taken = [legend.get_window_extent()] if legend else []
    for x, y, name in points:
        tried = []
        for dx, dy, side, level in LABEL_PLACES:
            text = axes.annotate(
                name, (x, y), xytext=(dx, dy), textcoords="offset points", ha=side, va=level,
                fontsize=7.5, color=INK,
            )  # fmt: skip
            box = text.get_window_extent()
            inside = axes.bbox.contains(*box.min) and axes.bbox.contains(*box.max)
            covers = box.count_contains(drawn) + 10 * box.count_overlaps(taken) + 5 * (not inside)
            tried.append((covers, text, box))
        _, kept, room = min(tried, key=lambda each: each[0])
        taken.append(room)
        for _, text, _ in tried:
            if text is not kept:
                text.remove()


def few_ticks(axis: Axis, values: Sequence[float]) -> None:
    """Where so few decades are shown that their parts want numbers too: at 2, 3 and 5, which have room."""
    if values and max(values) < 30 * min(values):
        axis.set_minor_locator(LogLocator(subs=(2, 3, 5)))
        axis.set_minor_formatter("{x:g}")
    else:
        axis.set_minor_formatter(NullFormatter())


def stage_plot(points: Sequence[cost_stages.Point]) -> Plot:
    """Seconds of one stage across; noise downwards or PSNR upwards; Pareto front and the chosen point."""
    rendering = points[0].stage == "render"
    scale = 100.0 if rendering else 1.0
    best = cost_stages.front(points)

    def paint(inches: float = WIDE_IN) -> Figure:
        figure = new_figure(inches, 3.4)
        axes = figure.add_subplot()
        for some, colour, line, marker, size, label in (
            (best, BLUE, "-", "o", None, "Pareto front"),
            ([p for p in points if p not in best], MUTED, "", "o", None, "beaten"),
            ([p for p in points if p.chosen], GREEN, "", "*", 14, "by default"),
        ):
            if some:
                axes.plot(
                    [p.seconds for p in some], [p.value * scale for p in some], label=label,
                    color=colour, linestyle=line, marker=marker, markersize=size,
                )  # fmt: skip
        axes.set_xscale("log")
        axes.xaxis.set_major_formatter("{x:g}")
        few_ticks(axes.xaxis, [p.seconds for p in points])
        axes.margins(x=0.18, y=0.12)
        if rendering:
            axes.set_yscale("log")
            axes.yaxis.set_major_formatter("{x:g}")
            few_ticks(axes.yaxis, [p.value for p in points])
        axes.set_xlabel("seconds of rendering" if rendering else "seconds of restoring")
        axes.set_ylabel("noise of a pixel (%)" if rendering else "PSNR against the ideal image (dB)")
        axes.legend(loc="best")
        name_points(axes, [(p.seconds, p.value * scale, p.name) for p in points])
        return figure

    what = "Noise of rendering" if rendering else "Quality of restoration"
    chosen = ", ".join(f"{p.name} in {p.seconds:.2g} s" for p in points if p.chosen) or "none"
    return Plot(
        paint,
        alt=f"{what} against seconds. By default: {chosen}.",
        caption=f"{what} against seconds.",
        paint_narrow=lambda: paint(NARROW_IN),
    )


def cost_page(
    path: Path,
    scene: str,
    rows: Sequence[Measured],
    points: Sequence[cost_stages.Point],
    numbers: Mapping[str, float],
) -> Path:
    """Write the page: the photo, then rendering and restoration where they were measured."""
    (chosen,) = [row for row in rows if row.case.kind == "chosen"]
    head = Keys(
        (
            Key(
                "chosen for the photo", f"{chosen.measured_db:.1f}", "dB", "against everything in full", True
            ),
            Key("in", f"{chosen.seconds:.2g}", "s"),
            Key("as fast as in full", f"{numbers['times_faster.chosen']:.1f}", "times", "photo alone"),
        )
    )
    sections = [
        Section("Photo", (cost_plot(rows, scene), photo_table(rows), *_said_of_parts(rows))),
        Section("Restored photo", (shift_table(rows), Text(SHIFTS))),
    ]
    for stage, title in (("render", "Rendering"), ("restore", "Restoration")):
        some = [point for point in points if point.stage == stage]
        if some:
            sections.append(Section(title, (stage_plot(some), stage_table(some), *_said(stage))))
    purpose = "Where more time stops paying: error, noise and quality against seconds, measured."
    return write_page(path, Page(f"What accuracy costs: {scene}", purpose, tuple(sections), (head,)))


def _said_of_parts(rows: Sequence[Measured]) -> tuple[Block, ...]:
    if not any(row.case.one_part for row in rows):
        return ()
    return (
        Text(
            "Effects that depth edges are not needed for are left out where the pupil is one part, and are "
            "judged against the full simulation with one part."
        ),
    )


def _said(stage: str) -> tuple[Block, ...]:
    if stage == "render":
        return (Text("Each rendering was timed once. Noise is the standard error of a pixel's mean band."),)
    return (Text("Each network has its own mask. Wiener deconvolution knows the PSFs, not the depth."),)


def photo_table(rows: Sequence[Measured]) -> Table:
    columns = (
        Column("case"),
        Column("measured", "dB"),
        Column("predicted", "dB"),
        Column("time", "s", 3),
        Column("predicted", "s", 3),
        *(Column(stage, "s", 3) for stage in cost.STAGES),
    )
    cells = tuple(
        (
            _name(row),
            _finite(row.measured_db),
            _finite(row.case.predicted_db),
            row.seconds,
            row.case.predicted_seconds,
            *(row.stages.get(stage, 0.0) for stage in cost.STAGES),
        )
        for row in rows
    )
    return Table(columns, cells)


def shift_table(rows: Sequence[Measured]) -> Table:
    """How far each case shifts what is concluded from restored photos, and what noise does from seed to
    seed."""
    judged = [row for row in rows if row.shifts and row.case.kind != "full"]
    scores = list(dict.fromkeys(name for row in judged for name in row.shifts))
    columns = [Column("case")]
    for name in scores:
        columns += [Column(f"{name}, shift", "dB", 3), Column("noise", "dB", 3)]
    cells = [
        (_name(row), *(value for name in scores for value in (row.shifts[name].mean, row.shifts[name].noise)))
        for row in judged
    ]
    return Table(tuple(columns), tuple(cells))


def _name(row: Measured) -> str:
    before = {"without": "without ", "target": "for "}
    return before.get(row.case.kind, "") + row.case.name


def _finite(value: float) -> float | None:
    return value if abs(value) != float("inf") else None


def stage_table(points: Sequence[cost_stages.Point]) -> Table:
    rendering = points[0].stage == "render"
    value = Column("noise", "%", 2) if rendering else Column("PSNR", "dB", 2, "largest")
    scale = 100.0 if rendering else 1.0
    error = () if rendering else (Column("standard error", "dB", 3),)
    rows = tuple(
        (point.name, point.value * scale, point.seconds, point.chosen, *(point.error for _ in error))
        for point in points
    )
    return Table((Column("with"), value, Column("time", "s", 3), Column("by default"), *error), rows)
