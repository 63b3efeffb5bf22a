"""The paper's table of methods: a test chart and photographs at three depths, folder averages at random ones.

Akpinar et al., section "Test Images": read noise 0.005, height error 30 nm. For the average each picture
stands at a random depth, uniform in inverse depth over [0.5 m, infinity], the same for all systems. Scores
are taken twice: of frame crops of larger pictures, and of pictures as they are, as the paper does (see
`planes`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from ..core.progress import Progress, part
from ..core.words import counted
from ..options import (
    ChartOption,
    LensOption,
    LimitOption,
    PicturesOption,
    SeedOption,
    ShowOption,
    SystemsOption,
)
from ..report import Column, Key, Keys, Page, Section, Text
from ..report import Table as PageTable
from ..report.page import Block, Cell
from ..report.words import number
from .experiment import Findings, in_paper
from .paper_figures import METHOD_OF, METHODS, TABLE
from .photographs import Photographs, chart, chosen, photographs
from .planes import (
    ABOUT,
    CHANNELS,
    RANDOM,
    Condition,
    PictureScore,
    averages,
    left_out,
    measure,
    pairs,
    sharp,
    write_rows,
)
from .systems import READ_NOISE, paper_test, usable_systems
from .training import Training

DEPTHS_M = (0.5, 0.8, 1.0)
DEPTH_NAMES = {RANDOM: "random depth", "0.5m": "0.5 m", "0.8m": "0.8 m", "1m": "1 m"}
SHOWN = 2


@dataclass(frozen=True)
class Result:
    """chart_rows: the chart alone.
    rows: the folder's pictures.
    shown: names of those with pictures.
    trainings: by system, None where nothing was trained.
    """

    chart_rows: tuple[PictureScore, ...]
    rows: tuple[PictureScore, ...]
    data: Photographs
    shown: tuple[str, ...]
    figures: dict[str, float]
    trainings: Mapping[str, Training | None]


@dataclass(frozen=True)
class Protocol:
    """What frames are.

    kind: its part of the names of figures.
    of_row: the PSNR of a row.
    """

    kind: str
    title: str
    of_row: Callable[[PictureScore], float]


GOES_ON = Protocol("", "Frame crops of larger pictures", lambda row: row.restored_db)
WHOLE = Protocol("whole.", "By the paper's protocol: whole pictures", lambda row: row.whole_restored_db)


@in_paper(
    lambda paper: {"data": paper.photos, "chart_file": paper.chart, "limit": paper.limit, "seed": paper.seed}
)
def run(
    folder: Path,
    progress: Progress,
    data: PicturesOption = None,
    systems: SystemsOption = None,
    camera: LensOption = None,
    chart_file: ChartOption = None,
    show: ShowOption = None,
    limit: LimitOption = None,
    seed: SeedOption = 0,
) -> Findings:
    """Compare masks and restorations on pictures.

    PSNR at a random depth, and at 0.5, 0.8 and 1 m, of pictures and a test chart (paper, Table I).

    The same command resumes interrupted work. A file that cannot be used is named and
    left out, and so is a system. Systems that were trained for comparison are among the default ones.
    Masks are made as the paper tests them, whatever a recipe's [fabrication] says.

    Figures: psnr_db.SYSTEM.{random,0.5m,0.8m,1m} of the restored middles of the pictures,
    psnr_db.SYSTEM.photo.* alike, psnr_db.SYSTEM.chart.{0.5m,0.8m,1m}, each also psnr_db.SYSTEM.whole.*, of
    whole pictures that mirror images continue; psnr_db.SYSTEM.chart.DEPTH.{red,green,blue}, and
    psnr_db.SYSTEM.known-depth.chart.* alike, of a linear restoration that is given the depth;
    {steps,steps_before,hours}.SYSTEM of its training, pictures, left_out.
    """
    found = photographs(data, limit)
    shown = chosen(found.pictures, show or (), SHOWN)
    target = chart(chart_file)
    every, failures = usable_systems(systems, every=True, camera=camera)
    fixed = [Condition(f"{m:g}m", 1 / m, READ_NOISE, paper_test(seed)) for m in DEPTHS_M]
    conditions = [Condition(RANDOM, None, READ_NOISE, paper_test(seed)), *fixed]
    rows: list[PictureScore] = []
    chart_rows: list[PictureScore] = []
    for index, system in enumerate(every):
        whole = part(progress, index / len(every), (index + 1) / len(every))
        begin, rest = part(whole, 0.0, 0.1), part(whole, 0.1, 1.0)
        with failures.of(system.name):
            how = {"seed": seed, "show": [target.name], "known_depth": True, "progress": begin}
            first = measure(system, [target], fixed, folder, **how)
            rows += measure(system, found.pictures, conditions, folder, seed=seed, show=shown, progress=rest)
            chart_rows += first
    every = [system for system in every if system.name not in failures.found]
    failures.check(len(every))
    figures = averages(rows) | chart_figures(chart_rows)
    for system in every:
        if (training := system.training) is not None:
            figures[f"steps.{system.name}"] = training.steps
            figures[f"steps_before.{system.name}"] = training.before
            figures |= {} if training.hours is None else {f"hours.{system.name}": training.hours}
    figures |= {"pictures": len(found.pictures), "left_out": len(found.problems)}
    trainings = {system.name: system.training for system in every}
    result = Result(tuple(chart_rows), tuple(rows), found, shown, figures, trainings)
    return Findings(
        figures,
        page(result),
        shown=[methods(result, GOES_ON), methods(result, WHOLE), chart_table(result)],
        outputs={"table": write_rows(folder / "table.csv", [*chart_rows, *rows], "depth")},
        problems=[*found.problems, *failures.sentences],
        inputs={"data": found.source},
    )


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
        Section("Averages and the chart", (methods(result, GOES_ON), methods(result, WHOLE))),
        Section("The chart by colour", (chart_table(result),)),
        Section("Single pictures", tuple(_singles(result, systems, scenes, p) for p in (GOES_ON, WHOLE))),
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


def methods(result: Result, protocol: Protocol) -> PageTable:
    """A row a system: its training, averages, and the chart; beneath them the paper's."""
    fixed = [f"{m:g}m" for m in DEPTHS_M]
    columns = (
        Column("System"),
        Column("Own steps"),
        Column("Hours", "h"),
        Column("Photos, random depth", "dB", 2),
        *(Column(f"Restored, {DEPTH_NAMES[label]}", "dB", 2, "largest") for label in (RANDOM, *fixed)),
        *(Column(f"Chart, {DEPTH_NAMES[label]}", "dB", 2, "largest") for label in fixed),
    )
    rows: list[tuple[Cell, ...]] = []
    for system, training in result.trainings.items():
        base = f"psnr_db.{system}.{protocol.kind}"
        names = [RANDOM, *fixed, *(f"chart.{label}" for label in fixed)]
        scores = (result.figures[base + name] for name in names)
        stands = METHOD_OF.get(system)
        name = system if stands is None else f"{system}\n{stands}"
        hours = None if training is None else training.hours
        rows.append((name, _steps(training), hours, result.figures[f"{base}photo.{RANDOM}"], *scores))
    for place, method in enumerate(METHODS):
        averages = [(scene, values[place]) for (scene, depth), values in TABLE.items() if depth == RANDOM]
        singles = [_paper_mean(place, label, "(Kodak)") for label in fixed]
        charts = [_paper_mean(place, label, "chart") for label in fixed]
        for number_, (scene, value) in enumerate(averages):
            own = (*singles, *charts) if number_ == 0 else (None,) * (len(singles) + len(charts))
            rows.append((f"the paper: {method}\n{scene}", None, None, None, value, *own))
    said = (
        f"{protocol.title}. Mean of {counted(len(result.data.pictures), 'picture')}, read noise 0.005, "
        "height errors of 30 nm; below a system the method of the paper that it stands for. The paper's are "
        "of its own draw of depths, its two pictures of Kodak's at a fixed depth, and its USAF chart."
    )
    return PageTable(columns, tuple(rows), said)


def chart_figures(rows: Sequence[PictureScore]) -> dict[str, float]:
    """Figures of the chart: both protocols, each channel, and what is restored by who is given the depth."""
    figures: dict[str, float] = {}
    for row in rows:
        for each in (GOES_ON, WHOLE):
            figures[f"psnr_db.{row.system}.{each.kind}chart.{row.condition}"] = each.of_row(row)
        own, linear = (f"psnr_db.{row.system}.{kind}chart.{row.condition}" for kind in ("", "known-depth."))
        figures[linear] = row.known_depth_db[0]
        for name, values in ((own, row.channels_db), (linear, row.known_depth_db[1:])):
            figures |= {f"{name}.{c}": v for c, v in zip(CHANNELS, values, strict=True)}
    return figures


def chart_table(result: Result) -> PageTable:
    """The chart by colour, and what a linear restoration that is given the depth makes of its photos."""
    names = ("all", *CHANNELS)
    columns = (
        Column("System"),
        Column("Depth"),
        *(Column(f"Restored, {name}", "dB", 2) for name in names),
        *(Column(f"Given the depth, {name}", "dB", 2) for name in names),
    )
    rows = tuple(
        (row.system, DEPTH_NAMES[row.condition], row.restored_db, *row.channels_db, *row.known_depth_db)
        for row in result.chart_rows
    )
    said = (
        "The chart as a frame crop. Given the depth: a linear filter over all colours and the whole photo, "
        "which knows the distance and the mask as made. A system below it does not lose that by its mask."
    )
    return PageTable(columns, rows, said)


def _steps(training: Training | None) -> str | None:
    if training is None:
        return None
    return f"{training.steps}\nafter {training.before} of another" if training.before else f"{training.steps}"


def _paper_mean(place: int, depth: str, of: str) -> float:
    """The mean of a method's PSNRs in the paper, over its scenes whose name has `of` in it."""
    values = [row[place] for (scene, at), row in TABLE.items() if at == depth and of in scene]
    return sum(values) / len(values)


def _singles(result: Result, systems: Sequence[str], scenes: Sequence[str], protocol: Protocol) -> PageTable:
    """Every shown picture at the three depths; the paper's proposed system on its own scenes next to them."""
    rows_of = {(r.system, r.picture, r.condition): r for r in (*result.chart_rows, *result.rows)}
    fixed = [f"{m:g}m" for m in DEPTHS_M]
    theirs = list(dict.fromkeys(scene for scene, depth in TABLE if depth != RANDOM))
    paper = [f"the paper: {METHODS[-1]}", f"the paper: {METHODS[0]}"]
    columns = (Column("Picture"), Column("Depth"), *(Column(s, "dB", 2) for s in (*systems, *paper)))
    rows = []
    for number_, scene in enumerate(scenes):
        for label in fixed:
            values = TABLE.get((theirs[number_], label)) if number_ < len(theirs) else None
            papers = (values[-1], values[0]) if values else (None, None)
            ours = (protocol.of_row(rows_of[system, scene, label]) for system in systems)
            rows.append((scene, DEPTH_NAMES[label], *ours, *papers))
    return PageTable(
        columns,
        tuple(rows),
        f"{protocol.title}, restored. The paper's columns are of its Scenes 1 to 3: a USAF chart and two "
        "images of Kodak's that it does not name, so that they need not be the ones here.",
    )
