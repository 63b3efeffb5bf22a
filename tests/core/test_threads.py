"""Pieces of work side by side."""

from __future__ import annotations

import threading

import pytest
import torch

from edofsim.core.threads import in_threads, one_thread_an_operation

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


def test_what_goes_wrong_in_a_piece_is_raised(two_threads):
    with pytest.raises(ZeroDivisionError):
        in_threads(lambda number: 1 // number, [1, 0], CPU)
    assert torch.get_num_threads() == 2
