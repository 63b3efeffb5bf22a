"""Progress of parts is progress of the whole."""

from __future__ import annotations

from edofsim.core.progress import part, silent


def test_parts_fill_the_whole_in_turn():
    reported: list[tuple[float, str]] = []
    for number, name in enumerate(("first", "")):
        tell = part(lambda done, text: reported.append((done, text)), number / 2, (number + 1) / 2, name)
        for done in (0.0, 0.5, 1.0):
            tell(done, "working")
    assert reported == [
        *((done, "first: working") for done in (0.0, 0.25, 0.5)),
        *((done, "working") for done in (0.5, 0.75, 1.0)),
    ]


def test_parts_of_parts():
    reported: list[tuple[float, str]] = []
    outer = part(lambda done, text: reported.append((done, text)), 0.5, 1.0, "scene")
    part(outer, 0.0, 0.5, "mask")(1.0, "rays")
    assert reported == [(0.75, "scene: mask: rays")]


def test_what_nobody_follows_is_silent():
    assert part(None, 0.0, 1.0) is silent
    assert silent(0.5, "working") is None
