"""The page of `edofsim cost`: a chart and a table for each stage."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from matplotlib.figure import Figure

from ..experiments import cost, cost_stages
from .cost_chart import cost_plot, few_ticks
from .page import Block, Column, Key, Keys, Page, Section, Table, Text, write_page
from .plot import BLUE, GREEN, INK, MUTED, NARROW_IN, WIDE_IN, Plot, new_figure


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
        for index, point in enumerate(points):
            axes.annotate(
                point.name, (point.seconds, point.value * scale), xytext=(7, 4 if index % 2 else -11),
                textcoords="offset points", fontsize=7.5, color=INK,
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
    rows: Sequence[cost.Row],
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
    sections = [Section("Photo", (cost_plot(rows, scene), _photo_table(rows), *_said_of_parts(rows)))]
    for stage, title in (("render", "Rendering"), ("restore", "Restoration")):
        some = [point for point in points if point.stage == stage]
        if some:
            sections.append(Section(title, (stage_plot(some), _stage_table(some), *_said(stage))))
    purpose = "Where more time stops paying: error, noise and quality against seconds, measured."
    return write_page(path, Page(f"What accuracy costs: {scene}", purpose, tuple(sections), (head,)))


def _said_of_parts(rows: Sequence[cost.Row]) -> tuple[Block, ...]:
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


def _photo_table(rows: Sequence[cost.Row]) -> Table:
    columns = (
        Column("case"),
        Column("measured", "dB"),
        Column("predicted", "dB"),
        Column("time", "s", 3),
        Column("predicted", "s", 3),
        *(Column(stage, "s", 3) for stage in cost.STAGES),
    )
    names = {"without": "without ", "target": "for ", "chosen": "", "full": ""}
    cells = tuple(
        (
            names[row.case.kind] + row.case.name,
            _finite(row.measured_db),
            _finite(row.case.predicted_db),
            row.seconds,
            row.case.predicted_seconds,
            *(row.stages.get(stage, 0.0) for stage in cost.STAGES),
        )
        for row in rows
    )
    return Table(columns, cells)


def _finite(value: float) -> float | None:
    return value if abs(value) != float("inf") else None


def _stage_table(points: Sequence[cost_stages.Point]) -> Table:
    rendering = points[0].stage == "render"
    value = Column("noise", "%", 2) if rendering else Column("PSNR", "dB", 2, "largest")
    scale = 100.0 if rendering else 1.0
    rows = tuple((point.name, point.value * scale, point.seconds, point.chosen) for point in points)
    return Table((Column("with"), value, Column("time", "s", 3), Column("by default")), rows)
