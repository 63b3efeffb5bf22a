"""Pages of the experiments on photographs as planes: the table of methods, sensor noise, fabrication."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from ..experiments import robustness, table
from ..experiments.paper_figures import FABRICATION, METHOD_OF, METHODS, NOISE, TABLE
from ..experiments.photographs import Photographs
from ..experiments.planes import RANDOM, Row
from .page import Block, Column, Gallery, Key, Keys, Notes, Page, Section, Table, Text
from .pictures import Picture, picture_file
from .plot import WIDE_IN, Plot, line_plot
from .words import decibels, listed, number

PROTOCOL = (
    "8-bit values are taken as intensities; red, green and blue are 611, 543 and 482 nm; the mask is sampled "
    "every 3 µm and has height errors; mirror images continue a picture beyond its border. PSNR over all "
    "channels, averaged over the pictures."
)
MIDDLES = "The middle of the picture, pixel for pixel; the PSNR is of the whole picture."
DEPTH_NAMES = {RANDOM: "random depth", "0.5m": "0.5 m", "0.8m": "0.8 m", "1m": "1 m"}


def table_page(result: table.Result) -> Page:
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
            blocks.append(_pairs(rows, system, lambda row: DEPTH_NAMES[row.condition]))
        sections.append(Section(scene, (_sharp(everything, scene), *blocks)))
    return Page(
        "Table of methods",
        "Which aperture and restoration give the sharpest pictures over the whole depth range.",
        tuple(sections),
        (Keys(keys), Text(PROTOCOL), *_left_out(result.data)),
        {"Pictures": Path(result.data.source).name},
    )


def noise_page(result: robustness.Result) -> Page:
    """Sensor noise."""
    labels = {f"{sigma:g}": sigma for sigma in robustness.SIGMAS_S}
    return _robustness_page(
        result,
        "Sensor noise",
        "How much read noise of the sensor the restoration bears.",
        labels,
        NOISE,
        "read noise σs (of full scale)",
        "σs = {}",
        "an object at the green focus, height errors of 30 nm; the paper trained with σs from 0.001 to 0.015",
        "Figure “Reconstruction results for increasing sensor read noise”",
    )


def fabrication_page(result: robustness.Result) -> Page:
    """Fabrication errors."""
    labels = {f"{sigma:g}nm": sigma for sigma in robustness.SIGMAS_D_NM}
    return _robustness_page(
        result,
        "Fabrication errors",
        "How much error in the height of the mask the restoration bears.",
        labels,
        FABRICATION,
        "height error σd (nm)",
        "σd = {} nm",
        "an object at the green focus, read noise 0.005; one draw of height errors at every strength; "
        "the device has 98 levels, a mean error of 44 nm and σd = 49.5 nm, as the paper measured on the one "
        "that was made. A network that was trained with height errors expects the haze that they make: "
        "with a "
        "smoother mask than it knows it may score lower",
        "Figure “Reconstruction results for increasing height-map noise”",
    )


def _robustness_page(
    result: robustness.Result,
    title: str,
    purpose: str,
    labels: Mapping[str, float],
    paper: Mapping[float, float],
    axis: str,
    name: str,
    setting: str,
    source: str,
) -> Page:
    systems = list(dict.fromkeys(row.system for row in result.rows))
    conditions = list(dict.fromkeys(row.condition for row in result.rows))
    figures = result.figures
    said = {c: name.format(f"{labels[c]:g}") if c in labels else "the made device" for c in conditions}
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
    blocks: tuple[Block, ...] = (
        _curves(figures, systems, labels, paper, axis, title),
        Table(columns, rows, f"Restored pictures, mean of {len(result.data.pictures)}; {source}: one image."),
        Table(columns[:-1], photos, "The photos themselves."),
    )
    sections = [Section("Scores", blocks)]
    for picture in result.shown:
        galleries = [
            _pairs(
                [r for r in result.rows if (r.system, r.picture) == (system, picture)],
                system,
                lambda row: said[row.condition],
            )
            for system in systems
        ]
        sections.append(Section(picture, (_sharp(result.rows, picture), *galleries)))
    about = f"{PROTOCOL} Here: {setting}."
    facts = {"Pictures": Path(result.data.source).name}
    return Page(title, purpose, tuple(sections), (Keys(keys), Text(about), *_left_out(result.data)), facts)


def _curves(
    figures: Mapping[str, float],
    systems: Sequence[str],
    labels: Mapping[str, float],
    paper: Mapping[float, float],
    axis: str,
    title: str,
) -> Plot:
    """PSNR over the strength of an error, the paper's figures among them."""
    series = [
        (system, list(labels.values()), [figures[f"psnr_db.{system}.{label}"] for label in labels])
        for system in systems[:4]
    ]
    series.append(("the paper (one image)", list(paper), list(paper.values())))
    ends = "; ".join(f"{n} from {decibels(ys[0])} to {decibels(ys[-1])}" for n, _, ys in series)
    return line_plot(
        series,
        x=axis,
        y="PSNR of the restored (dB)",
        alt=f"{title}: PSNR of the restored pictures against {axis}: {ends}.",
        caption="Mean PSNR of the restored pictures. The paper's points are of its one image: compare "
        "slopes, not heights.",
        width=WIDE_IN,
    )


def _averages(result: table.Result, systems: Sequence[str]) -> Table:
    labels = [RANDOM, *(f"{m:g}m" for m in table.DEPTHS_M)]
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
    return Table(columns, rows, f"Mean of {len(result.data.pictures)} pictures, read noise 0.005, "
                 "height errors of 30 nm.")  # fmt: skip


def _paper_averages() -> Table:
    rows = tuple((scene, *values) for (scene, depth), values in TABLE.items() if depth == RANDOM)
    columns = (Column("The paper's"), *(Column(name, "dB", 2) for name in METHODS))
    return Table(columns, rows, "The paper's averages at a random depth, of its Table “Quantitative analysis "
                 "of the DOF extension methods”. Its draw of depths is unknown.")  # fmt: skip


def _singles(result: table.Result, systems: Sequence[str], scenes: Sequence[str]) -> Table:
    """Every shown picture at the three depths; the paper's proposed system on its own scenes beside them."""
    rows_of = {(r.system, r.picture, r.condition): r for r in (*result.chart_rows, *result.rows)}
    fixed = [f"{m:g}m" for m in table.DEPTHS_M]
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
    return Table(
        columns,
        tuple(rows),
        "Restored. The paper's columns are of its Scenes 1 to 3: a USAF chart and two images of Kodak's that "
        "it does not name, so that they need not be the ones here.",
    )


def _pairs(rows: Sequence[Row], system: str, said: Callable[[Row], str]) -> Gallery:
    """Sensor and output side by side, condition below condition."""
    pictures: list[Picture] = []
    for row in rows:
        if row.shown is None:
            continue
        for path, what, db in (
            (row.shown.photo, "sensor", row.photo_db),
            (row.shown.restored, "output", row.restored_db),
        ):
            alt = f"{row.picture}, {what} of {system}, {said(row)}: {decibels(db)}."
            pictures.append(picture_file(path, f"{said(row)}, {what}", alt, note=decibels(db)))
    return Gallery(tuple(pictures), MIDDLES, columns=4, pixels=True, title=system)


def _sharp(rows: Sequence[Row], name: str) -> Gallery:
    shown = next(r.shown for r in rows if r.picture == name and r.shown)
    truth = picture_file(shown.sharp, "truth", f"{name}, the middle of the picture as it is.")
    return Gallery((truth,), "What is photographed.", columns=4, pixels=True)


def _left_out(data: Photographs) -> tuple[Block, ...]:
    if not data.problems:
        return ()
    names = listed([Path(problem.split(": ")[0]).name for problem in data.problems])
    return (Notes((f"Left out, since they cannot be used: {names}.", *data.problems)),)
