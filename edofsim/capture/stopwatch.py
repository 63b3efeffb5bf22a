"""Seconds of the stages of a photo."""

from __future__ import annotations

import time
from collections.abc import Callable

from ..core.progress import Progress


class Stopwatch:
    """seconds: of each stage that is over, by name; each is reported to whoever shows progress."""

    def __init__(
        self, progress: Progress | None = None, clock: Callable[[], float] = time.perf_counter
    ) -> None:
        self.seconds: dict[str, float] = {}
        self._progress = progress
        self._clock = clock
        self._started = clock()

    def lap(self, stage: str, fraction: float) -> None:
        """The stage is over, and `fraction` of all the work done."""
        now = self._clock()
        self.seconds[stage], self._started = now - self._started, now
        if self._progress:
            self._progress(fraction, stage)
