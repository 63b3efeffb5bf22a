"""Error against seconds: the sweep of targets, its Pareto front, the chosen point, effects left out."""

from __future__ import annotations

import math
from collections.abc import Sequence

from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from ..experiments.cost import Row, pareto
from .plot import BLUE, GREEN, INK, MUTED, NARROW_IN, ORANGE, WIDE_IN, Plot, new_figure


def cost_plot(rows: Sequence[Row], scene: str) -> Plot:
    """The chart of `edofsim cost`: seconds of a photo across, accuracy upwards."""
    rows = [row for row in rows if math.isfinite(row.measured_db) and row.seconds > 0]
    targets = [row for row in rows if row.case.kind == "target"]
    without = sorted((row for row in rows if row.case.kind == "without"), key=lambda row: row.measured_db)
    chosen = [row for row in rows if row.case.kind == "chosen"]
    front = pareto([*targets, *chosen])

    def paint(inches: float = WIDE_IN) -> Figure:
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
        for index, row in enumerate(without):
            axes.annotate(
                row.case.name, (row.seconds, row.measured_db), xytext=(6, 3 if index % 2 else -9),
                textcoords="offset points", fontsize=7.5, color=INK,
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
        return figure

    best = f"{chosen[0].measured_db:.1f} dB in {chosen[0].seconds:.2g} s" if chosen else "none"
    return Plot(
        paint,
        alt=f"Accuracy against seconds for {scene}. Chosen: {best}.",
        caption=f"What accuracy costs for {scene}: PSNR of the noise-free photo against the full simulation. "
        "Crosses: one effect left out of a plan for 60 dB.",
        paint_narrow=lambda: paint(NARROW_IN),
    )


def few_ticks(axis: Axis, values: Sequence[float]) -> None:
    """Where so few decades are shown that their parts want numbers too: at 2, 3 and 5, which have room."""
    if values and max(values) < 30 * min(values):
        axis.set_minor_locator(LogLocator(subs=(2, 3, 5)))
        axis.set_minor_formatter("{x:g}")
    else:
        axis.set_minor_formatter(NullFormatter())
