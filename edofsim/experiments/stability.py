"""The hard cases: what strains the numbers, and how far they are from right."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated

import typer

from ..core.progress import Progress
from ..errors import InputError
from ..optics import Camera
from ..options import CameraOption
from ..recipe import load_camera
from ..report import Column, Key, Keys, Page, Section, Table, Text
from ..report.words import significant
from ..stability import catalogue
from ..stability.catalogue import CaseResult
from .experiment import Findings


def run(
    folder: Path,
    progress: Progress,
    names: Annotated[
        list[str] | None,
        typer.Argument(metavar="[CASE...]", help="Cases or groups of cases; default all."),
    ] = None,
    camera: CameraOption = None,
    mutants: Annotated[bool, typer.Option("--mutants", hidden=True)] = False,
) -> Findings:
    """Run the catalogue of hard cases.

    It measures the error of every method, camera and precision against a reference.

    With --camera, that camera takes all cases in place of small ones.

    Figures: cases, findings, against_truth, against_itself, beyond_bound, failed, single_precision, seconds.
    """
    if mutants:
        raise InputError("--mutants: broken simulators are tests now; in a checkout, type: make test-all")
    loaded = None if camera is None else load_camera(camera)
    own = None if loaded is None else Camera.from_recipe(loaded.recipe, loaded.base)
    results = catalogue.run(names or (), progress, own)
    numbers = catalogue.figures(results)
    summary = (
        f"{numbers['cases']:.0f} cases, {numbers['findings']:.0f} findings in {numbers['seconds']:.0f} s: "
        f"{numbers['against_truth']:.0f} against a truth that is not this code, "
        f"{numbers['against_itself']:.0f} of the code against itself; "
        f"{numbers['beyond_bound']:.0f} beyond their bound, {numbers['failed']:.0f} cases without an end; "
        f"float32 photos differ from float64 by at most {numbers['single_precision']:.1g} of the local value"
    )
    return Findings(
        numbers,
        page(results, numbers),
        shown=[_short(results), summary],
        outputs={"findings": catalogue.write_table(folder / "stability.csv", results)},
    )


def page(results: Sequence[CaseResult], numbers: Mapping[str, float]) -> Page:
    """Case by case: what it is, what could go wrong, and the finding nearest to its bound.

    numbers: see `stability.catalogue.figures`.
    """
    groups: dict[str, list[CaseResult]] = {}
    for result in results:
        groups.setdefault(result.case.group, []).append(result)
    keys = (
        Key("cases", f"{numbers['cases']:.0f}", remark=f"{numbers['findings']:.0f} findings"),
        Key("against a truth", f"{numbers['against_truth']:.0f}"),
        Key("against itself", f"{numbers['against_itself']:.0f}"),
        Key("beyond their bound", f"{numbers['beyond_bound'] + numbers['failed']:.0f}", strong=True),
        Key("float32 against float64", significant(numbers["single_precision"], 2), remark="worst photo"),
        Key("time", f"{numbers['seconds']:.0f}", "s"),
    )
    about = (
        "Each case runs every way that applies: methods, masks, precisions. Photos are held against photos "
        "that are written out with code of their own, relative to the local value, or to the sensor's noise "
        "where that is more. What compares the code with itself, float32 with float64 or a slope with a "
        "difference, is counted apart. The way nearest to its bound is shown."
    )
    sections = tuple(Section(name.capitalize(), (_table(group),)) for name, group in groups.items())
    return Page(
        "Hard cases",
        "What strains the numbers, and how far they are from right.",
        sections,
        (Keys(keys), Text(about)),
    )


def _table(group: Sequence[CaseResult]) -> Table:
    columns = (
        Column("case"),
        Column("what could go wrong"),
        Column("expected"),
        Column("ways"),
        Column("beyond bound"),
        Column("nearest to its bound"),
        Column("error"),
        Column("bound"),
        Column("time", "s", 2),
    )
    return Table(columns, tuple(_row(result) for result in group), wordy=True)


def _row(result: CaseResult) -> tuple[str | bool | float | None, ...]:
    worst, case = result.worst, result.case
    return (
        f"{case.name}\n{case.physics}",
        case.risk,
        case.expected,
        str(len(result.findings)),
        result.failed or not result.holds,
        worst.way if worst else None,
        significant(worst.error, 2) if worst else None,
        significant(worst.bound, 2) if worst else None,
        sum(finding.seconds for finding in result.findings),
    )


def _short(results: Sequence[CaseResult]) -> Table:
    """A row a case, for a terminal."""
    rows = []
    for result in results:
        worst = result.worst
        cells = ("", "", "") if worst is None else (worst.way, f"{worst.error:.2g}", f"{worst.bound:.2g}")
        holds = result.failed or ("yes" if result.holds else "NO")
        rows.append((result.case.name, result.case.group, str(len(result.findings)), holds, *cells))
    names = ("case", "group", "ways", "holds", "nearest to its bound", "error", "bound")
    return Table(tuple(Column(name) for name in names), tuple(rows))
