"""Ctrl-C and a batch system's SIGTERM, taken only between two launches so that sums are never half added."""

from __future__ import annotations

import signal
import threading
from collections.abc import Generator
from contextlib import contextmanager
from types import FrameType


class Interruption:
    """Whether somebody asked to stop."""

    def __init__(self) -> None:
        self.signal: int | None = None

    def take(self, number: int, frame: FrameType | None) -> None:
        """Signal handler. The second Ctrl-C does not wait."""
        if self.signal is not None:
            raise KeyboardInterrupt
        self.signal = number

    def raise_if_asked(self) -> None:
        """Raises KeyboardInterrupt, or SystemExit after SIGTERM."""
        if self.signal == signal.SIGINT:
            raise KeyboardInterrupt
        if self.signal is not None:
            raise SystemExit(128 + self.signal)


@contextmanager
def interruptible() -> Generator[Interruption]:
    """Collect the wish to stop while this runs. Outside of the main thread signals never arrive, and nothing
    is changed."""
    wish = Interruption()
    if threading.current_thread() is not threading.main_thread():
        yield wish
        return
    numbers = (signal.SIGINT, signal.SIGTERM)
    before = [signal.signal(number, wish.take) for number in numbers]
    try:
        yield wish
    finally:
        for number, handler in zip(numbers, before, strict=True):
            signal.signal(number, handler)
