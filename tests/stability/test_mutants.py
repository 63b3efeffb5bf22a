"""Broken simulators are noticed by the hard cases, each by every group that it concerns."""

from __future__ import annotations

import pytest
import torch
from mutants import MUTANTS, applied, judge

from edofsim.capture.occlusion.slabs import cuts, hides
from edofsim.errors import InputError
from edofsim.stability.views import half, layered_view

AUDITED = {
    ("black where composited", "coverage"),
    ("plain blur", "coverage"),
    ("small values to zero", "radiance"),
}
"""Mutants that cases once let pass."""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("mutant", "group"),
    [pytest.param(*pair, id=f"{pair[0].name}-{pair[1]}".replace(" ", "-")) for pair in judge.choose()],
)
def test_mutant_is_killed(mutant, group):
    verdict = judge.judge(mutant, group)
    assert verdict.killed, f"{mutant.does}: {verdict.findings} findings, none beyond its bound"


@pytest.mark.parametrize(
    ("name", "group"),
    [*sorted(AUDITED), ("hidden fragments ignored", "coverage"), ("read noise 2 % down", "sensor")],
)
def test_cases_can_fail(name, group):
    (mutant,) = (each for each in MUTANTS if each.name == name)
    assert judge.judge(mutant, group).killed


def test_each_mutant_has_a_name_of_its_own_and_groups_that_are_there():
    assert len(MUTANTS) >= 40 and len({mutant.name for mutant in MUTANTS}) == len(MUTANTS)
    assert {group for mutant in MUTANTS for group in mutant.groups} <= set(judge.SELECTED)
    assert {(mutant.name, group) for mutant in MUTANTS for group in mutant.groups} >= AUDITED
    for group in judge.SELECTED:
        assert len(judge.cases_of(group)) == len(judge.SELECTED[group])


def test_the_simulator_is_whole_after_a_mutant():
    """Nothing of a mutant is left: a group that killed one holds again."""
    (mutant,) = (each for each in MUTANTS if each.name == "bands reversed")
    assert judge.judge(mutant, "sensor").killed
    assert all(finding.holds for case in judge.cases_of("sensor") for finding in case.check())


def test_every_mutant_can_be_applied_and_taken_back():
    for mutant in MUTANTS:
        if "renderer" not in mutant.groups:  # these need an engine
            with applied(mutant):
                pass


def test_unknown_mutants_are_refused():
    assert {group for _, group in judge.choose(["sensor"])} == {"sensor"}
    with pytest.raises(InputError, match="no mutant or group 'nothing'.*sensor"):
        judge.choose(["nothing"])


def test_what_is_hidden_is_found_behind_the_visible_rest_of_its_pixel():
    """In a pixel that an edge crosses the background is seen beside the front and hidden behind it: two
    fragments at one depth, of which the front hides the second."""
    view = layered_view(half(0.5, 0.5), 1.2, 0.4, 1.0)
    found = hides(view, 0.1)
    assert len(found.front) == int(view.hidden.sum())
    assert torch.equal(view.pixel[found.front], view.pixel[found.behind])
    assert bool((view.inverse_depth[found.front] == 1.2).all() and view.hidden[found.behind].all())
    (cut,) = cuts(view, 0.1)
    assert 0.4 < cut < 1.2
    assert not hides(view, 0.9).front.numel()
