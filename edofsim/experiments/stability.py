"""The hard cases: what strains the numbers, and how far they are from right."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated

import typer

from ..core.progress import Progress
from ..record import write_csv
from ..report import Column, Key, Keys, Page, Section, Table, Text
from ..report.words import significant
from ..stability import catalogue
from ..stability.catalogue import CaseResult
from ..stability.mutants import MUTANTS, judge
from ..stability.mutants.judge import Verdict
from .experiment import Findings
from .kept import Kept, key_of


def run(
    folder: Path,
    progress: Progress,
    names: Annotated[
        list[str] | None,
        typer.Argument(metavar="[CASE...]", help="Cases, groups of cases or mutants; default all."),
    ] = None,
    mutants: Annotated[
        bool,
        typer.Option(
            help="Break the simulator in every way that is known, and see whether the cases notice."
        ),
    ] = False,
) -> Findings:
    """The catalogue of hard cases: error against a truth of every method, mask and precision.

    Figures: cases, findings, against_truth, against_itself, beyond_bound, failed, single_precision, seconds;
    with mutants: mutants, pairs, killed, killed_percent, ended, unnoticed, seconds.
    """
    if mutants:
        return _mutants(folder, progress, names or ())
    results = catalogue.run(names or (), progress)
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


def _mutants(folder: Path, progress: Progress, names: Sequence[str]) -> Findings:
    """Every mutant against the groups that it concerns; what is finished is kept in the folder."""
    pairs = judge.choose(names)
    kept = Kept(folder / "mutants.jsonl")
    verdicts: list[Verdict] = []
    for number, (mutant, group) in enumerate(pairs):
        progress(number / len(pairs), f"{mutant.name}, {group}")
        key = key_of(mutant=mutant.name, group=group)
        found = kept.get(key)
        if found is None:
            verdicts.append(judge.judge(mutant, group))
            kept.put(key, verdicts[-1].as_json())
        else:
            verdicts.append(Verdict.from_json(found))
    numbers = judge.figures(verdicts)
    summary = (
        f"{numbers['mutants']:.0f} mutants, {numbers['pairs']:.0f} pairs of a mutant and a group in "
        f"{numbers['seconds']:.0f} s: {numbers['killed']:.0f} killed ({numbers['killed_percent']:.1f} %), "
        f"{numbers['ended']:.0f} of them by an error; no group noticed {numbers['unnoticed']:.0f} mutants"
    )
    table = _verdicts(verdicts)
    keys = (
        Key("killed", f"{numbers['killed_percent']:.1f}", "%", strong=True),
        Key("mutants", f"{numbers['mutants']:.0f}", remark=f"{numbers['pairs']:.0f} pairs"),
        Key("noticed by no group", f"{numbers['unnoticed']:.0f}"),
        Key("time", f"{numbers['seconds']:.0f}", "s"),
    )
    about = (
        "The simulator is broken on purpose, in one way at a time, and shown to hard cases of each group "
        "that should notice. The first finding beyond its bound kills a mutant; one that survives is a hole."
    )
    parts = [Section(group.capitalize(), (_verdicts([v for v in verdicts if v.group == group]),))
             for group in judge.SELECTED if any(v.group == group for v in verdicts)]  # fmt: skip
    shown = Page(
        "Mutants",
        "Broken simulators, and whether the hard cases notice.",
        (Section("By mutant", (_matrix(verdicts),)), *parts),
        (Keys(keys), Text(about)),
    )
    return Findings(numbers, shown, shown=[table, summary], outputs={"verdicts": _write(folder, verdicts)})


def _write(folder: Path, verdicts: Sequence[Verdict]) -> Path:
    header = ("mutant", "group", "killed", "case", "way", "error", "bound", "ended", "findings", "seconds")
    rows = [
        (
            v.mutant,
            v.group,
            v.killed,
            v.case,
            v.way,
            v.error,
            v.bound,
            v.ended,
            v.findings,
            f"{v.seconds:.2f}",
        )
        for v in verdicts
    ]
    return write_csv(folder / "mutants.csv", header, rows)


def _verdicts(verdicts: Sequence[Verdict]) -> Table:
    """A row for each pair of a mutant and a group."""
    names = ("mutant", "group", "killed", "by the case", "way", "error", "bound")
    rows = [
        (
            verdict.mutant,
            verdict.group,
            "yes" if verdict.killed else "NO",
            verdict.case,
            verdict.ended or verdict.way,
            significant(verdict.error, 2) if verdict.way else "",
            significant(verdict.bound, 2) if verdict.way else "",
        )
        for verdict in verdicts
    ]
    return Table(tuple(Column(name) for name in names), tuple(rows))


def _matrix(verdicts: Sequence[Verdict]) -> Table:
    """Mutant by group: killed, or not; empty where it does not concern a group."""
    groups = [group for group in judge.SELECTED if any(v.group == group for v in verdicts)]
    found = {(v.mutant, v.group): "killed" if v.killed else "NO" for v in verdicts}
    does = {mutant.name: mutant.does for mutant in MUTANTS}
    rows = [
        (f"{name}\n{does[name]}", *(found.get((name, group), "") for group in groups))
        for name in dict.fromkeys(v.mutant for v in verdicts)
    ]
    return Table((Column("mutant"), *(Column(group) for group in groups)), tuple(rows), wordy=True)


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
