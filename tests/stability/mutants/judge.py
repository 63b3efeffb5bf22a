"""Every mutant against the groups of hard cases that it concerns, until a finding lies beyond its bound."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from hard_cases import CASES

from edofsim.errors import EdofsimError, InputError
from edofsim.stability import Case

from . import MUTANTS
from .mutant import Mutant, applied

SELECTED: Mapping[str, tuple[str, ...]] = {
    "depth": ("half a metre to infinity", "layers of one column"),
    "coverage": ("coverage 1 and hidden light", "half covered everywhere", "hidden coverage 1e-7"),
    "occlusion": (
        "both sides blurred",
        "both sides blurred by a cubic mask",
        "three behind one another",
        "white room",
        "bright before dark",
        "dark before bright",
        "white disc before a white wall",
    ),
    "radiance": ("one pixel of 1e12", "contrast 1e5", "automatic exposure", "one pixel of 1e6"),
    "spectrum": ("mercury", "two bands"),
    "image": ("one row", "one column"),
    "pupil": (
        "the paper's aperture",
        "a pupil of one sample",
        "mirrored",
        "a millimetre thick",
        "both sides of focus",
        "one sample",
        "grids odd and even",
    ),
    "sensor": (
        "read noise",
        "shot noise",
        "quantisation",
        "saturation",
        "mosaic",
        "all of a sensor",
        "response",
    ),
    "restoration": (
        "black against white",
        "equal images",
        "constant photo",
        "photo smaller than the PSF",
        "zeros of the MTF",
        "zeros of the MTF, no noise",
        "beyond full scale",
        "saturated photo",
        "photo of one row",
        "dark photo",
        "photographs",
        "flat colours",
    ),
    "training": ("dead channels",),
    "plan": ("35 mm f/4 before a picture",),
    "renderer": (
        "four patches",
        "behind a strip",
        "contrast 1e5 and a lamp seen",
        "one bounce",
        "white everywhere",
        "empty scene",
    ),
}
"""Cases of each group that mutants are shown to, the quickest first."""


@dataclass(frozen=True)
class Verdict:
    """Of one group on one mutant. case, way: where it was noticed, empty where it was not; error, bound:
    there; ended: the error that a case ended with, which is noticed too; findings: looked at;
    seconds: it took.
    """

    mutant: str
    group: str
    case: str = ""
    way: str = ""
    error: float = 0.0
    bound: float = 0.0
    ended: str = ""
    findings: int = 0
    seconds: float = 0.0

    @property
    def killed(self) -> bool:
        return bool(self.way or self.ended)


def cases_of(group: str) -> tuple[Case, ...]:
    """The selected cases of a group, in order."""
    known = {case.name: case for case in CASES if case.group == group}
    return tuple(known[name] for name in SELECTED[group])


def choose(names: Sequence[str] = ()) -> tuple[tuple[Mutant, str], ...]:
    """Pairs of a mutant and a group that it concerns: of these mutants or groups, all for no name. Raises
    InputError for a name that is neither."""
    known = {mutant.name for mutant in MUTANTS} | set(SELECTED)
    unknown = [name for name in names if name not in known]
    if unknown:
        raise InputError(
            f"no mutant or group {unknown[0]!r}; groups: {', '.join(SELECTED)}; leave the name out"
            " for all mutants"
        )
    return tuple(
        (mutant, group)
        for mutant in MUTANTS
        for group in mutant.groups
        if not names or mutant.name in names or group in names
    )


def judge(mutant: Mutant, group: str) -> Verdict:
    """Show a mutant to a group: the first finding beyond its bound kills it, as does a case that ends
    early."""
    begun = time.perf_counter()
    seen = 0
    with applied(mutant):
        for case in cases_of(group):
            try:
                for finding in case.check():
                    seen += 1
                    if not finding.holds:
                        spent = time.perf_counter() - begun
                        where = (case.name, finding.way, finding.error, finding.bound)
                        return Verdict(mutant.name, group, *where, findings=seen, seconds=spent)
            except (EdofsimError, ArithmeticError, LookupError, RuntimeError, TypeError, ValueError) as error:
                said = f"{type(error).__name__}: {error}".split("\n")[0]
                spent = time.perf_counter() - begun
                return Verdict(mutant.name, group, case.name, ended=said, findings=seen, seconds=spent)
    return Verdict(mutant.name, group, findings=seen, seconds=time.perf_counter() - begun)
