"""How much an error is borne: what the experiments on sensor noise and on fabrication have in common.

Akpinar et al., section "Noise Analysis": an object at the green focus. The paper shows one natural image;
here it is a folder.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from ..core.progress import Progress, part
from ..optics import focus_distance
from ..options import LimitOption, PicturesOption, SeedOption, ShowOption, SystemsOption
from ..report import Column, Key, Keys, Page, Plot, Section, Table, Text, line_plot
from ..report.page import Block
from ..report.plot import WIDE_IN
from ..report.words import decibels, number
from .experiment import Experiment, Findings
from .photographs import Photographs, chosen, photographs
from .planes import ABOUT, Condition, PictureScore, averages, left_out, measure, pairs, sharp, write_rows
from .systems import EvaluatedSystem, evaluated_systems

GREEN = 543e-9


@dataclass(frozen=True)
class Study:
    """An error and its strengths.

    name: of the files.
    column: of the CSV, that names the strength.
    conditions: for a system and a seed, from the least to the most.
    labels: those strengths as numbers, others stand next to.
    paper: PSNR by strength, of its one image.
    title, purpose, setting: for the page.
    axis, said: the strength with its unit, and in a text.
    source: the paper's figure.
    """

    name: str
    column: str
    conditions: Callable[[EvaluatedSystem, int], list[Condition]]
    labels: Mapping[str, float]
    paper: Mapping[float, float]
    title: str
    purpose: str
    axis: str
    said: str
    setting: str
    source: str


@dataclass(frozen=True)
class Result:
    """Rows of every system, picture and condition.

    shown: names of the pictures that are shown.
    """

    rows: tuple[PictureScore, ...]
    data: Photographs
    shown: tuple[str, ...]
    figures: dict[str, float]


def green_focus(system: EvaluatedSystem) -> float:
    """Distance in metres that is sharp at 543 nm: z_fG of the paper."""
    return float(focus_distance(system.camera, GREEN))


def command_of(study: Study, said: str) -> Experiment[...]:
    """The experiment of a study, also in `edofsim evaluate paper`, with the photographs, systems and seed of
    that. It raises InputError for what cannot be used.

    said: its help.
    """

    def run(
        folder: Path,
        progress: Progress,
        data: PicturesOption = None,
        systems: SystemsOption = None,
        show: ShowOption = None,
        limit: LimitOption = None,
        seed: SeedOption = 0,
    ) -> Findings:
        found = photographs(data, limit)
        shown = chosen(found.pictures, show or (), 1)
        every = evaluated_systems(systems)
        rows: list[PictureScore] = []
        figures: dict[str, float] = {}
        for index, system in enumerate(every):
            tell = part(progress, index / len(every), (index + 1) / len(every))
            conditions = study.conditions(system, seed)
            own = measure(system, found.pictures, conditions, folder, seed=seed, show=shown, progress=tell)
            means = averages(own)
            ends = list(study.labels)
            least, most = (means[f"psnr_db.{system.name}.{label}"] for label in (ends[0], ends[-1]))
            figures |= means | {f"loss_db.{system.name}": least - most}
            rows += own
        figures |= {"pictures": len(found.pictures), "left_out": len(found.problems)}
        outputs = {"table": write_rows(folder / f"{study.name}.csv", rows, study.column)}
        shows = page(study, Result(tuple(rows), found, shown, figures))
        inputs = {"data": found.source}
        return Findings(figures, shows, outputs=outputs, problems=found.problems, inputs=inputs)

    run.__doc__ = said
    return Experiment(
        run,
        lambda paper: {
            "data": paper.photos,
            "systems": paper.systems,
            "limit": paper.limit,
            "seed": paper.seed,
        },
    )


def page(study: Study, result: Result) -> Page:
    """Scores by strength next to the paper's, and the pictures."""
    systems = list(dict.fromkeys(row.system for row in result.rows))
    conditions = list(dict.fromkeys(row.condition for row in result.rows))
    figures = result.figures
    labels, paper = study.labels, study.paper
    said = {c: study.said.format(f"{labels[c]:g}") if c in labels else "the made device" for c in conditions}
    first, last = list(labels)[0], list(labels)[-1]
    paper_loss = list(paper.values())[0] - list(paper.values())[-1]
    keys = tuple(
        Key(
            f"{system}: loss",
            number(figures[f"loss_db.{system}"], 2),
            "dB",
            f"from {said[first]} to {said[last]}; the paper {number(paper_loss, 2)}",
            strong=index == 0,
        )
        for index, system in enumerate(systems[:3])
    )
    columns = (Column("Condition"), *(Column(s, "dB", 2) for s in systems), Column("The paper", "dB", 2))
    rows = tuple(
        (
            said[c],
            *(figures[f"psnr_db.{s}.{c}"] for s in systems),
            paper.get(labels[c]) if c in labels else None,
        )
        for c in conditions
    )
    photos = tuple((said[c], *(figures[f"psnr_db.{s}.photo.{c}"] for s in systems)) for c in conditions)
    count = len(result.data.pictures)
    blocks: tuple[Block, ...] = (
        _curves(study, figures, systems),
        Table(columns, rows, f"Restored pictures, mean of {count}; {study.source}: one image."),
        Table(columns[:-1], photos, "The photos themselves."),
    )
    sections = [Section("Scores", blocks)]
    for picture in result.shown:
        galleries = [
            pairs(
                [r for r in result.rows if (r.system, r.picture) == (system, picture)],
                system,
                lambda row: said[row.condition],
            )
            for system in systems
        ]
        sections.append(Section(picture, (sharp(result.rows, picture), *galleries)))
    about = f"{ABOUT} Here: {study.setting}."
    facts = {"Pictures": Path(result.data.source).name}
    head = (Keys(keys), Text(about), *left_out(result.data))
    return Page(study.title, study.purpose, tuple(sections), head, facts)


def _curves(study: Study, figures: Mapping[str, float], systems: Sequence[str]) -> Plot:
    """PSNR over the strength of an error, the paper's figures among them."""
    series = [
        (
            system,
            list(study.labels.values()),
            [figures[f"psnr_db.{system}.{label}"] for label in study.labels],
        )
        for system in systems[:4]
    ]
    series.append(("the paper (one image)", list(study.paper), list(study.paper.values())))
    ends = "; ".join(f"{n} from {decibels(ys[0])} to {decibels(ys[-1])}" for n, _, ys in series)
    return line_plot(
        series,
        x=study.axis,
        y="PSNR of the restored (dB)",
        alt=f"{study.title}: PSNR of the restored pictures against {study.axis}: {ends}.",
        caption="Mean PSNR of the restored pictures. The paper's points are of its one image: compare "
        "slopes, not heights.",
        width=WIDE_IN,
    )
