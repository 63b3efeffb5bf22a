"""Seconds of stages of work."""

from __future__ import annotations

import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import dataclass, field

from .progress import Progress, part


@dataclass
class Stopwatch:
    """seconds: of each stage that is over, by name; each is reported to whoever shows progress."""

    progress: Progress | None = None
    clock: Callable[[], float] = time.perf_counter
    seconds: dict[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._started = self.clock()

    def lap(self, stage: str, fraction: float) -> None:
        """The stage that began with the last one's end is over, and `fraction` of all the work done."""
        now = self.clock()
        self.seconds[stage], self._started = now - self._started, now
        if self.progress:
            self.progress(fraction, stage)

    @contextmanager
    def stage(self, name: str, begin: float, end: float) -> Generator[Progress]:
        """Time a stage that goes from one fraction of the whole to another; gives its own progress."""
        tell = part(self.progress, begin, end)
        tell(0.0, name)
        start = self.clock()
        yield tell
        self.seconds[name] = self.clock() - start
