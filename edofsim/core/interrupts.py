"""Ctrl-C and a batch system's SIGTERM, taken only where they leave nothing half done: after an import, and
where progress is reported."""

from __future__ import annotations

import signal
import threading
from collections.abc import Generator
from contextlib import contextmanager
from types import FrameType

from .progress import Progress

AGAIN_S = 0.02
"""An interrupt that came within an import is tried again after this many seconds."""


def interrupt_after_imports() -> None:
    """From now on Ctrl-C waits until what is being imported is there. In the main thread, once a process.

    Libraries in C lose what is raised within their import, and the command goes on as if nobody had asked;
    or they stay behind half made. Where interrupts are ignored (a shell's background jobs), or somebody else
    handles them, nothing is changed.
    """
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _interrupt)
        signal.signal(signal.SIGALRM, lambda *_: signal.raise_signal(signal.SIGINT))


def _interrupt(number: int, frame: FrameType | None) -> None:
    while frame is not None:
        if frame.f_code.co_filename == "<frozen importlib._bootstrap>":
            signal.setitimer(signal.ITIMER_REAL, AGAIN_S)
            return
        frame = frame.f_back
    raise KeyboardInterrupt


@contextmanager
def interruptible(progress: Progress) -> Generator[Progress]:
    """Within, Ctrl-C and SIGTERM are taken only where progress is reported through what this gives, and at
    the end: there KeyboardInterrupt is raised, or SystemExit after SIGTERM. A second Ctrl-C does not wait.

    Outside of the main thread signals never arrive, and nothing is changed.
    """
    if threading.current_thread() is not threading.main_thread():
        yield progress
        return
    asked: list[int] = []

    def note(number: int, frame: FrameType | None) -> None:
        if asked:
            raise KeyboardInterrupt
        asked.append(number)

    def take() -> None:
        if signal.SIGINT in asked:
            raise KeyboardInterrupt
        if asked:
            raise SystemExit(128 + asked[0])

    def say(done: float, text: str) -> None:
        progress(done, text)
        take()

    before = {number: signal.signal(number, note) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield say
        take()
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def stoppable() -> Generator[list[int]]:
    """Ctrl-C and SIGTERM ask for an end after the step; a second Ctrl-C ends at once."""
    asked: list[int] = []

    def ask(number: int, frame: FrameType | None) -> None:
        if asked and number == signal.SIGINT:
            raise KeyboardInterrupt
        asked.append(number)

    try:
        old = {number: signal.signal(number, ask) for number in (signal.SIGINT, signal.SIGTERM)}
    except ValueError:  # not the main thread: signals are someone else's
        yield asked
        return
    try:
        yield asked
    finally:
        for number, handler in old.items():
            signal.signal(number, handler)
