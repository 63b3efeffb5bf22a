"""The catalogue of hard cases holds; and it would say if it did not."""

from __future__ import annotations

import math

import pytest
from hard_cases import CASES, convergence, written_photos

from edofsim.errors import InputError
from edofsim.optics import Camera
from edofsim.recipe.camera import CameraRecipe
from edofsim.stability import Case, Finding
from edofsim.stability.catalogue import choose, figures, run_case, write_table

SLOW = {
    "psi 1000", "4096 wide", "killed in any step", "a hundred wires", "layers of one pixel",
    "layers of one column", "slanted through focus", "primes", "even", "one outlier", "flat colours",
    *convergence.SLOW,
}  # fmt: skip


@pytest.mark.parametrize(
    "case",
    [pytest.param(case, marks=pytest.mark.slow if case.name in SLOW else ()) for case in CASES],
    ids=lambda case: case.name.replace(" ", "-"),
)
def test_case_holds(case: Case):
    """Photos through two masks each; `make test-all` takes all."""
    holds(written_photos.QUICK.get(case.name, case))


@pytest.mark.slow
@pytest.mark.parametrize("case", written_photos.CASES, ids=lambda case: case.name.replace(" ", "-"))
def test_photos_hold_through_every_mask(case: Case):
    holds(case)


def holds(case: Case) -> None:
    result = run_case(case)
    assert not result.failed
    assert result.findings
    assert not [f"{f.way}: {f.error:.3g} > {f.bound:g}" for f in result.findings if not f.holds]


def test_there_are_eighty_cases_and_each_has_a_name():
    assert len(CASES) >= 80
    assert len({case.name for case in CASES}) == len(CASES)
    assert all((case.physics, case.risk, case.expected) for case in CASES)


def test_what_does_not_hold_is_said(tmp_path):
    def broken():
        yield Finding("finite", 0.5, 1.0, alike=True)
        yield Finding("NaN", math.nan, 1.0)
        yield Finding("far", 2.0, 1.0)
        raise ZeroDivisionError("no light")

    result = run_case(Case("broken", "image", "-", "-", "-", broken))
    assert [finding.holds for finding in result.findings] == [True, False, False]
    assert result.worst.way == "NaN"
    assert result.failed == "ZeroDivisionError: no light" and not result.holds
    numbers = figures([result])
    assert (numbers["findings"], numbers["beyond_bound"], numbers["failed"]) == (3, 2, 1)
    assert (numbers["against_truth"], numbers["against_itself"]) == (2, 1)
    lines = write_table(tmp_path / "found.csv", [result]).read_text().splitlines()
    assert len(lines) == 4 and lines[3].startswith("broken,image,far,truth,2,1,False")


def test_unknown_names_are_refused():
    assert choose(["pupil"], Camera.from_recipe(CameraRecipe(name="own")))
    assert choose(["depth"]) and {case.group for case in choose(["depth"])} == {"depth"}
    with pytest.raises(InputError, match="no hard case or group 'nothing'.*depth"):
        choose(["nothing"])
