"""The page of the hard cases."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ..stability.catalogue import CaseResult
from .page import Column, Key, Keys, Page, Section, Table, Text, write_page
from .words import significant

__all__ = ["stability_page", "write_page"]


def stability_page(results: Sequence[CaseResult], numbers: Mapping[str, float]) -> Page:
    """Case by case: what it is, what could go wrong, and the finding nearest to its bound.

    numbers: see `evaluate.stability.figures`.
    """
    groups: dict[str, list[CaseResult]] = {}
    for result in results:
        groups.setdefault(result.case.group, []).append(result)
    keys = (
        Key("cases", f"{numbers['cases']:.0f}", remark=f"{numbers['findings']:.0f} findings"),
        Key("beyond their bound", f"{numbers['beyond_bound'] + numbers['failed']:.0f}", strong=True),
        Key("float32 against float64", significant(numbers["single_precision"], 2), remark="worst photo"),
        Key("time", f"{numbers['seconds']:.0f}", "s"),
    )
    about = (
        "Each case runs every way that applies: methods, masks, precisions. An error is measured in the "
        "case's own terms against a closed form or a slower float64 computation; the way nearest to its "
        "bound is shown."
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
