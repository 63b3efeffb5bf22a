"""Sums over samples: what is launched, in which order, and what has come in so far.

All sums are float64 on the host. A launch covers some pixels of one group and one pass of samples; launches
are numbered, so that work which stopped after any of them goes on from there and ends in the same bytes.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from .depths import DepthSurvey
from .settings import RenderSettings

LAUNCH_BYTES = 1 << 27
"""Radiance of one launch in the engine's memory."""

MOST_SAMPLES = 1 << 16
LEAST_PASSES = 2
"""An error is estimated from the scatter between passes, pixel by pixel."""


@dataclass(frozen=True)
class Group:
    """Pixels of one layer that need the same sums: one surface each (bounds is None), or several.

    limits: float32 [pixel] for each surface that its rays pass (see `rays.Samples`).
    pixels: int64 [pixel].
    bounds: float32 [pixel, split].
    first: the sums of surface k of pixel i are at first + k len(pixels) + i.
    """

    limits: tuple[np.ndarray, ...]
    pixels: np.ndarray
    bounds: np.ndarray | None
    first: int

    @property
    def layer(self) -> int:
        """0 for what the pinhole sees, n for what is behind n surfaces."""
        return len(self.limits)

    @property
    def surfaces(self) -> int:
        return 1 if self.bounds is None else self.bounds.shape[1] + 1

    @property
    def slots(self) -> int:
        return self.surfaces * len(self.pixels)


def groups_of(surveys: list[DepthSurvey], limits: list[np.ndarray]) -> tuple[Group, ...]:
    """The groups of a view whose n-th layer is the n-th survey, behind surfaces with the first n limits
    (float32 [pixel of the frame]).

    surveys: [pixel, sample] each, 1/m.
    limits: [pixel] each, 1/m, float32.
    """
    out: list[Group] = []
    first = 0
    for layer, found in enumerate(surveys):
        several = found.several
        for chosen, bounds in ((~several, None), (several, found.bounds[several])):
            if chosen.any():
                pixels = found.pixels[chosen]
                out.append(Group(tuple(limit[pixels] for limit in limits[:layer]), pixels, bounds, first))
                first += out[-1].slots
    return tuple(out)


@dataclass(frozen=True)
class Launch:
    """Pixels `start` to `stop` of a group, in one pass.

    samples: a pixel that are traced.
    weight: as how many they count.
    """

    number: int
    group: int
    start: int
    stop: int
    samples: int
    weight: int


def pass_sizes(settings: RenderSettings) -> Iterator[int]:
    """Samples of each pass; endless up to MOST_SAMPLES if a noise is asked for."""
    size = settings.pass_samples
    wanted = MOST_SAMPLES if settings.noise is not None else settings.samples
    while wanted > 0:
        yield min(size, wanted)
        wanted -= size


def launches_of(groups: tuple[Group, ...], number: int, samples: int, bands: int) -> list[Launch]:
    """The launches of pass `number`: half as many samples behind edges as of what is seen."""
    launches: list[Launch] = []
    for index, group in enumerate(groups):
        count = samples if group.layer == 0 else -(-samples // 2)
        most = max(1, LAUNCH_BYTES // (4 * bands * count))
        for start in range(0, len(group.pixels), most):
            stop = min(start + most, len(group.pixels))
            launches.append(Launch(number, index, start, stop, count, samples))
    return launches


@dataclass
class Sums:
    """What came in.

    radiance: float64 [band, slot].
    count, inverse_depth: float64 [slot].
    half: float32 [band, slot], the radiance of every second pass alone.
    first, second: float64 [pixel of layer 0], of each full pass's band mean and of its square.
    launches, passes: done.
    samples: a pixel, of passes done.
    half_samples: of every second pass.
    broken: samples that were not finite and count as black.
    seconds: of all launches.
    last_pass: likewise of the last pass, whose kernels are compiled.
    """

    radiance: np.ndarray
    count: np.ndarray
    inverse_depth: np.ndarray
    half: np.ndarray
    first: np.ndarray
    second: np.ndarray
    launches: int = 0
    passes: int = 0
    samples: int = 0
    half_samples: int = 0
    broken: int = 0
    seconds: float = 0.0
    last_pass: float = 0.0

    @classmethod
    def empty(cls, groups: tuple[Group, ...], bands: int) -> Sums:
        """Nothing yet."""
        slots = sum(group.slots for group in groups)
        seen = sum(len(group.pixels) for group in groups if group.layer == 0)
        sums = (np.zeros((bands, slots)), np.zeros(slots), np.zeros(slots))
        return cls(*sums, np.zeros((bands, slots), np.float32), np.zeros(seen), np.zeros(seen))

    def arrays(self) -> dict[str, np.ndarray]:
        """The sums themselves, by name."""
        names = ("radiance", "count", "inverse_depth", "half", "first", "second")
        return {name: getattr(self, name) for name in names}

    def counters(self) -> dict[str, float]:
        """How far they are, by name."""
        names = ("launches", "passes", "samples", "half_samples", "broken", "seconds")
        return {name: getattr(self, name) for name in names}

    def add(self, launch: Launch, groups: tuple[Group, ...], result: LaunchResult) -> None:
        """Take in one launch."""
        group, share = groups[launch.group], launch.weight / launch.samples
        for surface in range(group.surfaces):
            at = group.first + surface * len(group.pixels)
            where = slice(at + launch.start, at + launch.stop)
            self.radiance[:, where] += share * result.radiance[surface]
            self.count[where] += share * result.count[surface]
            self.inverse_depth[where] += share * result.inverse_depth[surface]
            if launch.number % 2:
                self.half[:, where] += share * result.radiance[surface]
        if group.layer == 0:
            # Groups of layer 0 come first and one after the other.
            before = sum(len(other.pixels) for other in groups[: launch.group])
            mean = (
                sum(radiance.mean(axis=0, dtype=np.float64) for radiance in result.radiance) / launch.samples
            )
            self.first[before + launch.start : before + launch.stop] += mean
            self.second[before + launch.start : before + launch.stop] += mean**2
        self.broken += result.broken
        self.launches += 1

    def finished(self, number: int, samples: int) -> None:
        """All launches of a pass are in."""
        self.passes += 1
        self.samples += samples
        self.half_samples += samples * (number % 2)

    def half_difference(self, slots: np.ndarray) -> np.ndarray | None:
        """What the radiance of slots (int64 [slot]) is off by chance, as far as two independent halves of the
        samples tell: float32 [band, slot]; None where there is one pass alone.

        slots: [slot], int64.

        The halves are every second pass and the rest. Half of their difference has the variance of their
        mean; of halves of n and m samples it is sqrt(n m) / (n + m) of it, where variance falls as 1 /
        samples.
        """
        second, first = self.half_samples, self.samples - self.half_samples
        if not second or not first:
            return None
        share = np.sqrt(first * second) / self.samples
        out = np.empty((len(self.radiance), len(slots)), np.float32)
        for total, half, row in zip(self.radiance, self.half, out, strict=True):
            odd = half[slots].astype(np.float64)
            row[:] = share * ((total[slots] - odd) / first - odd / second)
        return out

    def noise(self) -> float:
        """Relative standard error of the band mean: root mean square over pixels, over the image's mean.

        NaN where fewer than two passes have come in. Passes are independent and samples within a pass are
        not, so this is the scatter between passes.
        """
        if self.passes < 2:
            return float("nan")
        mean = self.first / self.passes
        variance = np.clip(self.second / self.passes - mean**2, 0, None) / (self.passes - 1)
        level = float(mean.mean())
        return float(np.sqrt(variance.mean()) / level) if level > 0 else 0.0


@dataclass(frozen=True)
class LaunchResult:
    """Sums over the samples of each pixel, a list over surfaces: radiance [band, pixel], count [pixel],
    inverse_depth [pixel]."""

    radiance: list[np.ndarray] = field(default_factory=list)
    count: list[np.ndarray] = field(default_factory=list)
    inverse_depth: list[np.ndarray] = field(default_factory=list)
    broken: int = 0
