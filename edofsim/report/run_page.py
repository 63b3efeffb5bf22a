"""The page of a run: images, scores, depth, point spread functions, plan, times, how to repeat it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import torch

from ..core.images import developed
from ..core.threads import in_threads
from ..restore.gains import gains, gains_in_words
from ..restore.scores import Score, image_psnr
from .crops import Detail, choose_crops, near_focus_far
from .figures import depth_plot, score_plot, time_plot
from .figures_optics import height_plot, psf_plot
from .model import DepthRange, RunReport
from .page import (
    Block,
    Code,
    Column,
    Compare,
    Gallery,
    Key,
    Keys,
    Notes,
    Page,
    Pairs,
    Section,
    SideBySide,
    Sweep,
    Table,
    Text,
    Values,
    write_page,
)  # fmt: skip
from .pictures import (
    Box,
    Picture,
    clipped_fraction,
    depth_picture,
    display_gain,
    picture,
    with_boxes,
)
from .words import DASH, decibels, depth_range, distance, duration, number, percent, significant

CROP_PX = 72
FOCUSED_PX = 640
"""Of the longer side of pictures focused elsewhere, of which there are many."""
LETTERS = "ABC"


def write_report(path: Path, report: RunReport) -> Path:
    """Write the page of a run as one HTML file and return its path.

    Raises InputError where the place cannot be written.
    """
    return write_page(path, report_page(report))


def report_page(report: RunReport, crops: tuple[Detail, ...] | None = None) -> Page:
    """The page of a run.

    crops: parts to enlarge, in place of textured ones near, at focus and far.
    """
    chosen = crops is None
    if crops is None:
        ranges = sorted({(d.near_m, d.far_m) for s in report.scores.values() for d in s.by_depth})
        wanted = near_focus_far(report.inverse_depth, [DepthRange(*r) for r in ranges], report.focus_m)
        crops = choose_crops(report.inverse_depth, report.ideal, CROP_PX, wanted)
    gain = display_gain(developed(report.ideal, report.colours))
    shown = _pictures(report, gain)
    sections = [
        Section("Images", _images(report, shown, crops, gain)),
        Section("Focus", _focus(report, gain)),
        Section("Near and far" if len(crops) > 1 else "Enlarged", _crops(report, crops, gain, chosen)),
        Section("Depth and scores", _depth(report)),
        Section("Optics", _optics(report)),
        Section("Plan", _plan(report)),
        Section("Time and memory", _cost(report)),
        Section("Reproduce", _reproduce(report)),
    ]
    rows, columns = report.inverse_depth.shape
    return Page(
        title=report.title,
        purpose=report.purpose,
        facts={"Camera": report.camera, "Size": f"{columns} × {rows} px", **report.facts},
        head=_head(report),
        sections=tuple(s for s in sections if s.blocks),
    )


def verdict(report: RunReport) -> str:
    """What restoring gained, in one sentence; empty without a score of the restored image."""
    whole = {name: score.whole.psnr_db for name, score in report.scores.items()}
    return gains_in_words(gains(whole))


def _head(report: RunReport) -> tuple[Block, ...]:
    """Scores of the whole images, the verdict, and what must not be missed."""
    keys = tuple(
        Key(
            report.label(name),
            number(score.whole.psnr_db),
            "dB",
            f"{_uncertain(score.whole)}SSIM {number(score.whole.ssim, 3)}",
            strong=name == "restored",
        )
        for name, score in report.scores.items()
    )
    sentence = verdict(report)
    notes = (*report.notes, *_broken(report))
    return (
        *((Keys(keys),) if keys else ()),
        *((Text(sentence),) if sentence else ()),
        *((Notes(notes),) if notes else ()),
    )


def _uncertain(score: Score) -> str:
    """The standard error of a PSNR, where it has one that two decimals show."""
    return f"± {number(score.psnr_db_se, 2)} dB, " if score.psnr_db_se >= 0.005 else ""


def _broken(report: RunReport) -> list[str]:
    """Values that are no numbers are shown, and said."""
    found = []
    for name, image in report.images().items():
        count = int((~torch.isfinite(image)).any(0).sum())
        if count:
            found.append(
                f"{report.label(name)}: {count} pixels hold values that are not numbers; shown in magenta."
            )
    return found


def _pictures(report: RunReport, gain: float) -> dict[str, Picture]:
    what = {
        "ideal": "all in focus, without noise",
        "photo": f"as the sensor of {report.camera} records it",
        "restored": "computed from the photo",
        "wiener": "computed from the same photo by Wiener deconvolution",
        "lens_alone": "through the lens without a mask",
    }
    images = report.images()

    def one(name: str) -> Picture:
        label = report.label(name)
        score = report.scores.get(name)
        note = decibels(score.whole.psnr_db) if score else ""
        said = f"{label}: {report.title}, {what[name]}."
        return picture(images[name], label, said, gain=gain, note=note, colours=report.colours)

    return dict(zip(images, in_threads(one, list(images), torch.device("cpu")), strict=True))


def _images(
    report: RunReport, shown: dict[str, Picture], crops: tuple[Detail, ...], gain: float
) -> tuple[Block, ...]:
    width = report.inverse_depth.shape[-1]
    boxes = tuple(Box(c.x, c.y, c.size, c.size, LETTERS[i]) for i, c in enumerate(crops))
    framed = {**shown, "ideal": with_boxes(shown["ideal"], boxes, width)}
    how = "The sensor's own colours (raw)"
    if report.colours is not None:
        how = "White-balanced to the scene's light, from the sensor's colours to sRGB by a 3 × 3 matrix"
    exposure = "as exposed" if gain == 1 else f"brightened {gain:g} times for display"
    white = ", ".join(
        f"{report.label(name)} {percent(clipped_fraction(developed(image, report.colours), gain))}"
        for name, image in report.images().items()
    )
    caption = (
        f"{how}, {exposure}, the same for all; encoded with the sRGB curve. Values brighter than "
        f"the screen's white: {white}. "
        + ("The frames in the ideal image are the parts enlarged below." if crops else "")
    )
    right = "restored" if report.restored is not None else "ideal"
    return (
        Compare("images-all", report.label("photo"), report.label(right),
                "Drag the divider, or move it with the arrow keys; choose any two images above."),
        Gallery(tuple(framed.values()), caption, columns=2, name="images-all",
                values=_values(report, gain)),
    )  # fmt: skip


def _values(report: RunReport, gain: float) -> Values:
    """What the pointer reads: the sensor's values, whatever colours are shown."""
    depth = depth_picture(report.inverse_depth)
    if report.colours is None:
        return Values(gain, *depth)
    inverse = torch.linalg.inv(report.colours).flatten().tolist()
    return Values(gain, *depth, to_sensor=tuple(round(value, 6) for value in inverse))


def _focus(report: RunReport, gain: float) -> tuple[Block, ...]:
    """The slider over depth."""

    def one(focused: tuple[float, torch.Tensor]) -> Picture:
        at = distance(focused[0])
        said = f"{report.title}, {report.lens_alone_label.lower()} focused at {at}."
        return picture(focused[1], at, said, gain=gain, largest=FOCUSED_PX, colours=report.colours)

    pictures = tuple(in_threads(one, list(report.focused.items()), torch.device("cpu")))
    caption = (
        f"What {report.camera} sees without its mask when it is focused at another distance, without "
        "noise, in two groups of bands a channel and few depth layers."
    )
    return (Sweep(pictures, "Focused at", caption, "images-all"),) if pictures else ()


def _crops(
    report: RunReport, crops: tuple[Detail, ...], gain: float, chosen: bool = True
) -> tuple[Block, ...]:
    galleries = []
    images = report.images()
    for i, crop in enumerate(crops):
        truth = crop.cut(report.ideal)
        pictures = []
        for name, image in images.items():
            part = crop.cut(image)
            noise = crop.cut_noise(report.noises.get(name, "none"))
            note = "" if name == "ideal" else decibels(image_psnr(part, truth, noise=noise))
            alt = f"{report.label(name)}, enlarged part {LETTERS[i]} at {distance(crop.depth_m)}."
            how = {"gain": gain, "note": note, "colours": report.colours}
            pictures.append(picture(part, report.label(name), alt, **how))
        title = f"{LETTERS[i]} · {crop.range.name}: {_around(crop)}"
        caption = (
            f"Pixels {crop.x} to {crop.x + crop.size - 1} across, {crop.y} to {crop.y + crop.size - 1} down."
        )
        galleries.append(Gallery(tuple(pictures), caption, len(pictures), pixels=True, title=title))
    what = "The most textured square"
    if not chosen:
        what = "Parts of the objects"
    elif len(crops) > 1:
        what += "s at the nearest depths, around focus and at the farthest depths"
    note = Text(f"{what}, enlarged without smoothing; PSNR of the square itself.")
    return (note, *galleries) if galleries else ()


def _around(crop: Detail) -> str:
    return f"about {distance(crop.depth_m)}" if math.isfinite(crop.depth_m) else "infinity"


def _depth(report: RunReport) -> tuple[Block, ...]:
    plots: list[Block] = [depth_plot(report.inverse_depth, report.focus_m)]
    labels = {name: report.label(name) for name in report.scores}
    ranges = sorted({(d.near_m, d.far_m) for s in report.scores.values() for d in s.by_depth})
    if ranges:
        finite = report.inverse_depth[torch.isfinite(report.inverse_depth)]
        nearest = 1 / float(finite.max()) if finite.numel() and float(finite.max()) > 0 else 0.0
        plots.append(score_plot(report.scores, labels, report.focus_m, nearest))
    table = _score_table(report, ranges)
    return (SideBySide(tuple(plots)), *((table,) if table else ()))


def _score_table(report: RunReport, ranges: list[tuple[float, float]]) -> Table | None:
    if not report.scores:
        return None
    names = list(report.scores)
    pixels = report.inverse_depth.numel()

    def row(title: str, found: Sequence[Score | None]) -> tuple[str, ...]:
        count = next((s.pixels for s in found if s is not None), 0)
        share = percent(count / pixels)
        cells = (f"{number(s.psnr_db)}\n{number(s.ssim, 3)}" if s is not None else DASH for s in found)
        return (f"{title}\n{share}", *cells)

    rows = [row("Whole image", [report.scores[n].whole for n in names])]
    by_range = {n: {(d.near_m, d.far_m): d.score for d in report.scores[n].by_depth} for n in names}
    rows += [row(depth_range(*r), [by_range[n].get(r) for n in names]) for r in ranges]
    return Table(
        columns=(Column("Depth"), *(Column(report.label(n)) for n in names)),
        rows=tuple(rows),
        caption="Against the ideal image, both clipped to full scale 1: PSNR in dB, below it SSIM. Below "
        "each range, its part of the pixels.",
    )


def _optics(report: RunReport) -> tuple[Block, ...]:
    blocks: list[Block] = []
    if report.psfs is not None:
        blocks.append(psf_plot(report.psfs))
    if report.height_m is not None and report.mask_width_m is not None:
        blocks.append(height_plot(report.height_m, report.mask_width_m))
    return tuple(blocks)


def _plan(report: RunReport) -> tuple[Block, ...]:
    """The effects that were weighed; errors and times stand where the plan predicted any; what was
    simulated."""
    said = tuple(Text(sentence) for sentence in (report.target, report.fidelity) if sentence)
    if not report.plan:
        return said
    caption = "Effects of light that were weighed before the photo was taken."
    columns: list[tuple[str, list[str | bool]]] = [
        ("Effect", [row.effect for row in report.plan]),
        ("Simulated", [row.chosen for row in report.plan]),
    ]
    if any(row.error is not None for row in report.plan):
        columns.append(("Error if left out", [_error(row.error) for row in report.plan]))
        caption += (
            " The error is the root mean square over the sensor image at full scale 1, below it as PSNR."
        )
    if any(row.seconds is not None for row in report.plan):
        columns.append(("Time", [duration(row.seconds) for row in report.plan]))
    columns.append(("Why", [row.why for row in report.plan]))
    if any(row.lens_alone for row in report.plan):
        columns.append(("Lens alone", [row.lens_alone for row in report.plan]))
        caption += (
            " The photo through the lens alone has a plan of its own, with the choices of the last column; "
            "nothing is restored from it."
        )
    heads = tuple(Column(name) for name, _ in columns)
    rows = tuple(zip(*(cells for _, cells in columns), strict=True))
    table = Table(heads, rows, caption, wordy=True)
    chart = (report.cost,) if report.cost is not None else ()
    return (*said, table, *chart)


def _error(value: float | None) -> str:
    if value is None or not math.isfinite(value) or value <= 0:
        return significant(value, 2)
    return f"{significant(value, 2)}\n{decibels(-20 * math.log10(value))}"


def _cost(report: RunReport) -> tuple[Block, ...]:
    facts: dict[str, object] = {}
    if report.seconds:
        facts["total time"] = duration(sum(report.seconds.values()))
    if report.peak_memory_mib is not None:
        facts["peak memory"] = f"{number(report.peak_memory_mib, 0)} MiB"
    facts.update(_machine(report))
    table = (Pairs(facts),) if facts else ()
    if report.seconds:
        return (SideBySide((time_plot(report.seconds), *table)),)
    return table


def _reproduce(report: RunReport) -> tuple[Block, ...]:
    blocks: list[Block] = [Code(report.command)] if report.command else []
    blocks += [Code(text, title) for title, text in report.recipes.items()]
    if report.figures:
        listed = {name: _figure(value) for name, value in report.figures.items()}
        blocks.append(Pairs(listed, "All figures", closed=True))
    if report.versions:
        blocks.append(Pairs(report.versions, "Versions", closed=True))
    return tuple(blocks)


def _figure(value: float | str) -> str:
    return value if isinstance(value, str) else significant(value, 5)


def _machine(report: RunReport) -> dict[str, object]:
    names = {"memory_gib": "memory"}
    return {
        names.get(name, name.replace("_", " ")): f"{value} GiB" if name == "memory_gib" else value
        for name, value in report.machine.items()
    }
