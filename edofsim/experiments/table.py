"""The paper's table of methods: a test chart and photographs at three depths, folder averages at random ones.

Akpinar et al., section "Test Images": read noise 0.005, height error 30 nm. For the average each picture
stands at a random depth, uniform in inverse depth over [0.5 m, infinity], the same for all systems.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from .photographs import Photographs, chart, chosen, photographs
from .planes import RANDOM, Condition, Progress, Row, averages, measure, write_rows
from .systems import READ_NOISE, contestants, paper_test

DEPTHS_M = (0.5, 0.8, 1.0)
SHOWN = 2


@dataclass(frozen=True)
class Result:
    """chart_rows: the chart alone; rows: the folder's pictures; shown: names of those with pictures."""

    chart_rows: tuple[Row, ...]
    rows: tuple[Row, ...]
    data: Photographs
    shown: tuple[str, ...]
    figures: dict[str, float]


def run(
    out: Path,
    data: Path | None,
    *,
    systems: Sequence[str | Path] | None = None,
    chart_file: Path | None = None,
    show: Sequence[str] = (),
    seed: int = 0,
    limit: int | None = None,
    progress: Progress | None = None,
) -> Result:
    """Measure, write OUT/table.csv, and return all of it.

    data: folder of pictures, None for scikit-image's. systems: checkpoints (files or shipped names) and
    shipped cameras whose photos Wiener deconvolution restores; None for all that ship, those
    that were trained for comparison, and the clear and the cubic aperture. chart_file: picture of a chart,
    None for a drawn USAF-1951. show: names of pictures, the first two by default.

    Figures: psnr_db.SYSTEM.{random,0.5m,0.8m,1m} of the restored pictures, psnr_db.SYSTEM.photo.* of the
    photos, psnr_db.SYSTEM.chart.* of the chart, pictures, left_out. Raises InputError for pictures and
    systems that cannot be used.
    """
    found = photographs(data, limit)
    shown = chosen(found.pictures, show, SHOWN)
    target = chart(chart_file)
    every = contestants(systems, every=True)
    fixed = [Condition(f"{m:g}m", 1 / m, READ_NOISE, paper_test(seed)) for m in DEPTHS_M]
    conditions = [Condition(RANDOM, None, READ_NOISE, paper_test(seed)), *fixed]
    rows: list[Row] = []
    chart_rows: list[Row] = []
    for index, system in enumerate(every):

        def part(done: float, text: str, index: int = index) -> None:
            if progress:
                progress((index + done) / len(every), text)

        def begin(done: float, text: str, part: Progress = part) -> None:
            part(0.1 * done, text)

        def rest(done: float, text: str, part: Progress = part) -> None:
            part(0.1 + 0.9 * done, text)

        options = {"seed": seed}
        chart_rows += measure(system, [target], fixed, out, show=[target.name], progress=begin, **options)
        rows += measure(system, found.pictures, conditions, out, show=shown, progress=rest, **options)
    write_rows(out / "table.csv", [*chart_rows, *rows], "depth")
    figures = averages(rows)
    figures |= {f"psnr_db.{row.system}.chart.{row.condition}": row.restored_db for row in chart_rows}
    figures |= {"pictures": len(found.pictures), "left_out": len(found.problems)}
    return Result(tuple(chart_rows), tuple(rows), found, shown, figures)
