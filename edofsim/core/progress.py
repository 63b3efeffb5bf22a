"""How long work tells how far it is."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[float, str], None]
"""Called with the fraction done, from 0 to 1, and what is going on."""


def silent(done: float, text: str) -> None:
    """Progress that nobody asked for."""


def part(progress: Progress | None, start: float, end: float, what: str = "") -> Progress:
    """Progress of a part, which takes the whole from `start` to `end`, as progress of the whole.

    what: is said before what the part says. None for a whole that nobody follows.
    """
    if progress is None:
        return silent
    before = f"{what}: " if what else ""
    return lambda done, text: progress(start + done * (end - start), before + text)
