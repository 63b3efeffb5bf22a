"""Means over scenes, how sure they are, and differences between entries that saw the same photos.

Scenes are what a mean is over: another draw of scenes, and of the sensor's noise, would give another one.
Resampling both with replacement tells how far (Efron and Tibshirani, An Introduction to the Bootstrap, 1993,
chapters 6 and 13: percentiles).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

RESAMPLED = 2000
LEVEL = 0.95


@dataclass(frozen=True)
class Interval:
    """A mean over `scenes` scenes, and the ends of its interval; NaN where a single scene tells none."""

    mean: float
    low: float
    high: float
    scenes: int


def resamples(scenes: int, seeds: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Which scenes, [resample, scene], and which noise seeds of each, [resample, scene, seed], are taken."""
    rng = np.random.default_rng([seed, scenes, seeds])
    chosen = rng.integers(scenes, size=(RESAMPLED, scenes))
    return chosen, rng.integers(seeds, size=(RESAMPLED, scenes, seeds))


def interval(values: np.ndarray, seed: int = 0) -> Interval:
    """The mean of values [scene, seed] over scenes, NaN left out, with its bootstrap interval.

    values: [scene, seed].
    """
    known = ~np.isnan(values).all(1)
    values = values[known]
    if not len(values):
        return Interval(math.nan, math.nan, math.nan, 0)
    mean = float(np.nanmean(np.nanmean(values, 1)))
    if len(values) == 1:
        return Interval(mean, math.nan, math.nan, 1)
    scenes, seeds = resamples(values.shape[0], values.shape[1], seed)
    drawn = np.take_along_axis(values[scenes], seeds, 2)
    total, count = np.nansum(drawn, 2), (~np.isnan(drawn)).sum(2)
    each = np.where(count > 0, total / np.maximum(count, 1), np.nan)
    low, high = np.nanpercentile(np.nanmean(each, 1), [50 * (1 - LEVEL), 50 * (1 + LEVEL)])
    return Interval(mean, float(low), float(high), len(values))


def differences(by_entry: Mapping[str, np.ndarray], seed: int = 0) -> dict[tuple[str, str], Interval]:
    """Of every two entries: how much the first is above the second, photo by photo.

    by_entry: values [scene, seed] by name of the entry.
    """
    names = list(by_entry)
    return {
        (one, other): interval(by_entry[one] - by_entry[other], seed)
        for place, one in enumerate(names)
        for other in names[place + 1 :]
    }
