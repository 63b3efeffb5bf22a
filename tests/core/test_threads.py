"""Pieces of work side by side."""

from __future__ import annotations

import sys
import threading

import pytest
import torch

from edofsim.core.threads import SWITCH_S, in_threads, in_turns, one_thread, one_thread_an_operation

CPU = torch.device("cpu")


@pytest.fixture
def two_threads():
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    yield
    torch.set_num_threads(before)


def test_pieces_meet_and_pieces_of_a_piece_follow_each_other(two_threads):
    """Two pieces wait for each other, so they must run at once; each one's own pieces stay in its thread."""
    meet = threading.Barrier(2, timeout=20)

    def piece(number):
        meet.wait()
        inner = in_threads(lambda k: (threading.get_ident(), torch.get_num_threads()), range(3), CPU)
        return threading.get_ident(), inner

    for _ in range(2):
        with one_thread_an_operation():  # the operations' threads are one, the pieces' are as before
            found = in_threads(piece, range(2), CPU)
        assert len({ident for ident, _ in found}) == 2
        assert all(inner == [(ident, 1)] * 3 for ident, inner in found)
        assert torch.get_num_threads() == 2


@pytest.mark.parametrize("usual_s", [5e-3, 1e-5])
def test_threads_get_python_often_and_afterwards_as_before(usual_s: float):
    before = sys.getswitchinterval()
    sys.setswitchinterval(usual_s)
    usual = sys.getswitchinterval()  # in whole microseconds
    try:
        for _ in range(2):
            with one_thread_an_operation(), one_thread_an_operation():
                assert sys.getswitchinterval() == pytest.approx(min(SWITCH_S, usual), abs=1e-6)
            assert sys.getswitchinterval() == usual
    finally:
        sys.setswitchinterval(before)


def test_what_goes_wrong_in_a_piece_is_raised(two_threads):
    with pytest.raises(ZeroDivisionError):
        in_threads(lambda number: 1 // number, [1, 0], CPU)
    assert torch.get_num_threads() == 2


def test_chains_are_taken_to_their_ends_by_two_threads_and_each_by_one_at_a_time(two_threads):
    meet, under_way, done = threading.Barrier(2, timeout=20), set(), []

    def chain(name, steps):
        for number in range(steps):
            assert name not in under_way
            under_way.add(name)
            if number == 0 and name in "ab":
                meet.wait()
            done.append((name, number))
            under_way.remove(name)
            yield

    in_turns([chain("a", 3), chain("b", 1), chain("c", 40), chain("d", 0)], CPU)
    assert sorted(done) == [("a", 0), ("a", 1), ("a", 2), ("b", 0), *(("c", k) for k in range(40))]


def test_a_chain_that_fails_is_raised_once_the_others_have_ended(two_threads):
    ended = []

    def chain(name, steps):
        for number in range(steps):
            yield 1 // (name - number)
        ended.append(name)

    with pytest.raises(ZeroDivisionError):
        in_turns([chain(2, 4), chain(9, 3), chain(8, 5)], CPU)
    assert sorted(ended) == [8, 9]


def test_one_thread_takes_steps_in_turn():
    taken = []
    with one_thread():
        in_turns([map(taken.append, (f"{name}0", f"{name}1")) for name in "ab"], CPU)
    assert taken == ["a0", "b0", "a1", "b1"]
