"""Rates of this machine: what ships, corrected by what photos took."""

from __future__ import annotations

import time
from pathlib import Path

import pytest
import torch

from edofsim.core.threads import one_thread_an_operation
from edofsim.plan import rates
from edofsim.plan.work import KINDS, STAGES

MEASURED_PACES = rates.paces


@pytest.fixture(autouse=True)
def another_machine(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """A user without any cache, on a machine as fast as that of the shipped rates by the moment's work."""
    monkeypatch.setattr(rates, "_known", {})
    monkeypatch.setattr(rates, "user_folder", lambda: tmp_path)
    monkeypatch.setattr(rates, "paces", lambda: rates.TODAY[rates.PACE])
    return tmp_path


def predicted() -> dict[str, float]:
    """Seconds of each stage for amounts of work that take a second by the shipped rates."""
    return {
        stage: sum(now.values()) / sum(rates.TODAY[stage].values())
        for stage, now in rates.rates().items()
        if stage != rates.PACE
    }


@pytest.mark.parametrize("slower", [0.3, 1.0, 2.5, 4.0])
def test_after_three_photos_the_seconds_are_right_within_a_factor_of_one_and_a_half(slower: float):
    """Whatever this machine makes of the work, and though each photo is off by a quarter more or less."""
    assert predicted()["blur"] == pytest.approx(1.0)
    for noise in (0.8, 1.25, 1.0):
        before = predicted()
        rates.learn(before, {stage: noise * slower for stage in before})
    assert all(1 / 1.5 < seconds / slower < 1.5 for seconds in predicted().values())


def test_what_photos_took_is_known_while_each_operation_has_one_thread():
    """As planning works, with as many threads allowed as photos have."""
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    try:
        rates.learn({"blur": 1.0}, {"blur": 2.0})
        with one_thread_an_operation():
            assert predicted()["blur"] == pytest.approx(2.0)
    finally:
        torch.set_num_threads(before)


def test_a_slower_pace_makes_everything_slower(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(
        rates, "paces", lambda: {kind: 3 * each for kind, each in rates.TODAY[rates.PACE].items()}
    )
    assert all(seconds == pytest.approx(3.0) for seconds in predicted().values())


def test_a_machine_that_is_slow_at_one_kind_of_work_is_slow_at_that_alone(monkeypatch: pytest.MonkeyPatch):
    usual = rates.TODAY[rates.PACE]
    monkeypatch.setattr(rates, "paces", lambda: {**usual, "products": 10 * usual["products"]})
    found = rates.rates()
    slower = {
        (stage, kind)
        for stage, kinds in rates.TODAY.items()
        for kind, before in kinds.items()
        if stage != rates.PACE and found[stage][kind] > 5 * before
    }
    assert slower == {("psf", "products"), ("sub_apertures", "products")}


def test_what_says_nothing_of_the_machine_is_not_learned_from(another_machine: Path):
    """Moments, PSFs that were known already, and a photo that waited for other work."""
    rates.learn({"blur": 0.001, "psf": 1.0, "sensor": 1.0}, {"blur": 0.01, "psf": 0.001, "sensor": 60.0})
    assert not list(another_machine.iterdir()) and predicted()["sensor"] == pytest.approx(1.0)


@pytest.mark.parametrize("content", ["", "{", "[1]", '{"blur": [0]}', '{"blur": ["x"]}', '{"blur": [NaN]}'])
def test_a_damaged_file_counts_as_none(another_machine: Path, content: str):
    rates.learn({"blur": 1.0}, {"blur": 2.0})
    (file,) = another_machine.iterdir()
    file.write_text(content)
    rates._known.clear()
    assert predicted()["blur"] == pytest.approx(1.0)


def test_threads_with_pieces_of_their_own_gain_less_than_those_that_share_each_operation():
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    try:
        now = predicted()
    finally:
        torch.set_num_threads(before)
    # paces are of both threads: pieces on one of them would take twice as long, on two of them that by 2^0.4
    assert now["blur"] == pytest.approx(1.0)
    assert [now["psf"], now["sub_apertures"]] == pytest.approx(2 * [2 / 2**rates.SHARED])


def test_each_rate_is_of_a_kind_of_work():
    assert rates.TODAY.keys() == {*STAGES, rates.PACE} and all(
        0 < rate < 0.01 and kind in KINDS for kinds in rates.TODAY.values() for kind, rate in kinds.items()
    )


def test_paces_are_measured_in_a_moment():
    started = time.perf_counter()
    assert MEASURED_PACES().keys() == set(KINDS) and min(MEASURED_PACES().values()) > 0
    assert time.perf_counter() - started < 1
