"""The paper's table of methods: a test chart and photographs at three depths, folder averages at random ones.

Akpinar et al., section "Test Images": read noise 0.005, height error 30 nm. For the average each picture
stands at a random depth, uniform in inverse depth over [0.5 m, infinity], the same for all systems.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from ..core.progress import Progress, part
from ..options import LimitOption, PicturesOption, SeedOption, ShowOption, SystemsOption
from ..report import Column, Key, Keys, Page, Section, Text
from ..report import Table as PageTable
from ..report.page import Block
from ..report.words import number
from .experiment import Findings, in_paper
from .paper_figures import METHOD_OF, METHODS, TABLE
from .photographs import Photographs, chart, chosen, photographs
from .planes import ABOUT, RANDOM, Condition, Row, averages, left_out, measure, pairs, sharp, write_rows
from .systems import READ_NOISE, contestants, paper_test

DEPTHS_M = (0.5, 0.8, 1.0)
DEPTH_NAMES = {RANDOM: "random depth", "0.5m": "0.5 m", "0.8m": "0.8 m", "1m": "1 m"}
SHOWN = 2


@dataclass(frozen=True)
class Result:
    """chart_rows: the chart alone; rows: the folder's pictures; shown: names of those with pictures."""

    chart_rows: tuple[Row, ...]
    rows: tuple[Row, ...]
    data: Photographs
    shown: tuple[str, ...]
    figures: dict[str, float]


@in_paper(
    lambda paper: {"data": paper.photos, "chart_file": paper.chart, "limit": paper.limit, "seed": paper.seed}
)
def run(
    folder: Path,
    progress: Progress,
    data: PicturesOption = None,
    systems: SystemsOption = None,
    chart_file: Annotated[
        Path | None,
        typer.Option("--chart", metavar="FILE", help="Picture of a test chart; default: USAF-1951, drawn."),
    ] = None,
    show: ShowOption = None,
    limit: LimitOption = None,
    seed: SeedOption = 0,
) -> Findings:
    """Average PSNR at a random depth, and at 0.5, 0.8 and 1 m; a test chart and two photographs (Table I).

    Interrupt it at any time: the same command goes on from there. A file that cannot be used is named and
    left out. Systems that were trained for comparison are among the default ones.

    Figures: psnr_db.SYSTEM.{random,0.5m,0.8m,1m} of the restored pictures, psnr_db.SYSTEM.photo.* alike,
    psnr_db.SYSTEM.chart.{0.5m,0.8m,1m}, pictures, left_out.
    """
    found = photographs(data, limit)
    shown = chosen(found.pictures, show or (), SHOWN)
    target = chart(chart_file)
    every = contestants(systems, every=True)
    fixed = [Condition(f"{m:g}m", 1 / m, READ_NOISE, paper_test(seed)) for m in DEPTHS_M]
    conditions = [Condition(RANDOM, None, READ_NOISE, paper_test(seed)), *fixed]
    rows: list[Row] = []
    chart_rows: list[Row] = []
    for index, system in enumerate(every):
        whole = part(progress, index / len(every), (index + 1) / len(every))
        begin, rest = part(whole, 0.0, 0.1), part(whole, 0.1, 1.0)
        chart_rows += measure(system, [target], fixed, folder, seed=seed, show=[target.name], progress=begin)
        rows += measure(system, found.pictures, conditions, folder, seed=seed, show=shown, progress=rest)
    figures = averages(rows)
    figures |= {f"psnr_db.{row.system}.chart.{row.condition}": row.restored_db for row in chart_rows}
    figures |= {"pictures": len(found.pictures), "left_out": len(found.problems)}
    outputs = {"table": write_rows(folder / "table.csv", [*chart_rows, *rows], "depth")}
    result = Result(tuple(chart_rows), tuple(rows), found, shown, figures)
    inputs = {"data": found.source}
    return Findings(figures, page(result), outputs=outputs, problems=found.problems, inputs=inputs)


def page(result: Result) -> Page:
    """The table of methods."""
    systems = list(dict.fromkeys(row.system for row in result.rows))
    best = max(systems, key=lambda name: result.figures[f"psnr_db.{name}.{RANDOM}"])
    keys = (
        Key(
            f"{best}, random depth",
            number(result.figures[f"psnr_db.{best}.{RANDOM}"], 2),
            "dB",
            "restored; the best system here",
            strong=True,
        ),
        Key("its photos", number(result.figures[f"psnr_db.{best}.photo.{RANDOM}"], 2), "dB", "random depth"),
        Key("pictures", str(len(result.data.pictures))),
    )
    scenes = [*dict.fromkeys(row.picture for row in result.chart_rows), *result.shown]
    sections = [
        Section("Averages", (_averages(result, systems), _paper_averages())),
        Section("Single pictures", (_singles(result, systems, scenes),)),
    ]
    everything = [*result.chart_rows, *result.rows]
    for scene in scenes:
        blocks: list[Block] = []
        for system in systems:
            rows = [r for r in everything if (r.system, r.picture) == (system, scene)]
            rows = [r for r in rows if r.condition != RANDOM]
            blocks.append(pairs(rows, system, lambda row: DEPTH_NAMES[row.condition]))
        sections.append(Section(scene, (sharp(everything, scene), *blocks)))
    return Page(
        "Table of methods",
        "Which aperture and restoration give the sharpest pictures over the whole depth range.",
        tuple(sections),
        (Keys(keys), Text(ABOUT), *left_out(result.data)),
        {"Pictures": Path(result.data.source).name},
    )


def _averages(result: Result, systems: Sequence[str]) -> PageTable:
    labels = [RANDOM, *(f"{m:g}m" for m in DEPTHS_M)]
    columns = (
        Column("System"),
        Column("Stands for"),
        Column("photos, random depth", "dB", 2),
        *(Column(f"restored, {DEPTH_NAMES[label]}", "dB", 2, "largest") for label in labels),
    )
    rows = tuple(
        (
            system,
            METHOD_OF.get(system, "none of the paper's"),
            result.figures[f"psnr_db.{system}.photo.{RANDOM}"],
            *(result.figures[f"psnr_db.{system}.{label}"] for label in labels),
        )
        for system in systems
    )
    said = f"Mean of {len(result.data.pictures)} pictures, read noise 0.005, height errors of 30 nm."
    return PageTable(columns, rows, said)


def _paper_averages() -> PageTable:
    rows = tuple((scene, *values) for (scene, depth), values in TABLE.items() if depth == RANDOM)
    columns = (Column("The paper's"), *(Column(name, "dB", 2) for name in METHODS))
    said = (
        "The paper's averages at a random depth, of its Table “Quantitative analysis of the DOF extension "
        "methods”. Its draw of depths is unknown."
    )
    return PageTable(columns, rows, said)


def _singles(result: Result, systems: Sequence[str], scenes: Sequence[str]) -> PageTable:
    """Every shown picture at the three depths; the paper's proposed system on its own scenes beside them."""
    rows_of = {(r.system, r.picture, r.condition): r for r in (*result.chart_rows, *result.rows)}
    fixed = [f"{m:g}m" for m in DEPTHS_M]
    theirs = list(dict.fromkeys(scene for scene, depth in TABLE if depth != RANDOM))
    paper = [f"the paper: {METHODS[-1]}", f"the paper: {METHODS[0]}"]
    columns = (Column("Picture"), Column("Depth"), *(Column(s, "dB", 2) for s in (*systems, *paper)))
    rows = []
    for number_, scene in enumerate(scenes):
        for label in fixed:
            values = TABLE.get((theirs[number_], label)) if number_ < len(theirs) else None
            beside = (values[-1], values[0]) if values else (None, None)
            ours = (rows_of[system, scene, label].restored_db for system in systems)
            rows.append((scene, DEPTH_NAMES[label], *ours, *beside))
    return PageTable(
        columns,
        tuple(rows),
        "Restored. The paper's columns are of its Scenes 1 to 3: a USAF chart and two images of Kodak's that "
        "it does not name, so that they need not be the ones here.",
    )
