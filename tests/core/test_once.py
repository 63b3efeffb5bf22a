"""Things that are made once for several threads."""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor

import pytest

from edofsim.core.once import Once


def test_who_asks_meanwhile_waits_for_what_is_being_made():
    once, made, begun, go_on = Once(), [], threading.Event(), threading.Event()

    def make():
        begun.set()
        assert go_on.wait(10)
        made.append(len(made))
        return made[-1]

    with ThreadPoolExecutor(3) as pool:
        first = pool.submit(once.get, "a", make)
        assert begun.wait(10)
        others = [pool.submit(once.get, "a", make) for _ in range(2)]
        assert once.get("b", lambda: "another") == "another"  # no other thing is held up
        go_on.set()
        assert [each.result() for each in (first, *others)] == [0, 0, 0]
    assert made == [0]


def test_what_went_wrong_is_raised_and_tried_again():
    once = Once()
    with pytest.raises(ZeroDivisionError):
        once.get("a", lambda: 1 // 0)
    assert once.get("a", lambda: 1) == 1
