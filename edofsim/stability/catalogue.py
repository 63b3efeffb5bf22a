"""The catalogue of hard cases, run: every finding, and what stands out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ..core.progress import Progress
from ..errors import EdofsimError, InputError
from ..optics import Camera
from ..record import write_csv
from . import Case, Finding, cases_of

PHOTOS = ("depth", "coverage", "radiance", "spectrum", "image")
"""Groups of photos."""


@dataclass(frozen=True)
class CaseResult:
    """findings: of one case, in order.
    failed: what it ended with, if it did not come to its end.
    """

    case: Case
    findings: tuple[Finding, ...]
    failed: str = ""

    @property
    def holds(self) -> bool:
        return not self.failed and bool(self.findings) and all(finding.holds for finding in self.findings)

    @property
    def worst(self) -> Finding | None:
        """The finding nearest to its bound, or beyond it furthest."""

        def use(finding: Finding) -> float:
            if finding.error != finding.error:
                return float("inf")
            return finding.error / finding.bound if finding.bound else float(finding.error > 0)

        return max(self.findings, key=use, default=None)


def choose(names: Sequence[str] = (), camera: Camera | None = None) -> tuple[Case, ...]:
    """Cases by name or group, all of them for no name. Raises InputError for a name that is neither."""
    cases = cases_of(camera)
    groups = sorted({case.group for case in cases})
    known = {case.name for case in cases} | set(groups)
    unknown = [name for name in names if name not in known]
    if unknown:
        raise InputError(
            f"no hard case or group {unknown[0]!r}; groups: {', '.join(groups)}; leave the name out for all"
        )
    return tuple(case for case in cases if not names or case.name in names or case.group in names)


def run(
    names: Sequence[str] = (), progress: Progress | None = None, camera: Camera | None = None
) -> tuple[CaseResult, ...]:
    """Run the cases of these names or groups. A case that ends with an error is a result too."""
    cases = choose(names, camera)
    results = []
    for number, case in enumerate(cases):
        if progress:
            progress(number / len(cases), case.name)
        results.append(run_case(case))
    return tuple(results)


def run_case(case: Case) -> CaseResult:
    """One case, with what was found until an error ended it."""
    findings: list[Finding] = []
    try:
        for finding in case.check():
            findings.append(finding)
    except (EdofsimError, ArithmeticError, LookupError, RuntimeError, TypeError, ValueError) as error:
        return CaseResult(case, tuple(findings), f"{type(error).__name__}: {error}")
    return CaseResult(case, tuple(findings))


def figures(results: Sequence[CaseResult]) -> dict[str, float]:
    """cases, findings, seconds; against_truth: findings against a truth that is not this code;
    against_itself: those that compare the code with itself; beyond_bound: findings that do not hold;
    failed: cases without an end; single_precision: the largest local difference of float32 from float64
    among the photos."""
    findings = [finding for result in results for finding in result.findings]
    single = [
        finding.error
        for result in results
        if result.case.group in PHOTOS
        for finding in result.findings
        if finding.way.endswith("float32 against float64") and finding.error == finding.error
    ]
    return {
        "cases": float(len(results)),
        "findings": float(len(findings)),
        "against_truth": float(sum(not finding.alike for finding in findings)),
        "against_itself": float(sum(finding.alike for finding in findings)),
        "beyond_bound": float(sum(not finding.holds for finding in findings)),
        "failed": float(sum(bool(result.failed) for result in results)),
        "single_precision": max(single, default=0.0),
        "seconds": sum(finding.seconds for finding in findings),
    }


def write_table(path: Path, results: Sequence[CaseResult]) -> Path:
    """Every finding, a line each, as CSV."""
    header = ("case", "group", "way", "against", "error", "bound", "holds", "seconds")
    rows = [
        (
            r.case.name,
            r.case.group,
            f.way,
            "itself" if f.alike else "truth",
            f.error,
            f.bound,
            f.holds,
            f"{f.seconds:.4f}",
        )
        for r in results
        for f in r.findings
    ]
    return write_csv(path, header, rows)
