"""What a hard case is, and what was found when it ran."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

from ..optics import Camera


@dataclass(frozen=True)
class Finding:
    """One way through a case.

    way: method, mask, precision.
    error: its distance from the truth, in the case's own measure, NaN where something was not finite.
    bound: what is still right.
    seconds: it took.

    alike: the code was compared with itself, one precision or way with another; else with a truth that is not
        this code: a closed form, a sum written out, what a message must say.
    """

    way: str
    error: float
    bound: float
    seconds: float = 0.0
    alike: bool = False

    @property
    def holds(self) -> bool:
        return math.isfinite(self.error) and self.error <= self.bound


@dataclass(frozen=True)
class Case:
    """group: what it strains.
    physics: what it is.
    risk: what could go wrong.
    expected: what is right.
    check: runs it, yielding findings.
    """

    name: str
    group: str
    physics: str
    risk: str
    expected: str
    check: Callable[[], Iterator[Finding]]


Cameras = Callable[[], Mapping[str, Camera]]
"""The cameras of a case by name, made when it runs."""


def timed(way: str, bound: float, measure: Callable[[], float], *, alike: bool = False) -> Finding:
    """The finding of `measure`, which returns an error."""
    begun = time.perf_counter()
    error = measure()
    return Finding(way, float(error), bound, time.perf_counter() - begun, alike)
