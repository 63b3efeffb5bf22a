"""Depth of every sample before anything is averaged: which pixels see several surfaces.

Depth is inverse depth (1/m) throughout, 0 for the background. Averaging it over a pixel on an edge would
invent a surface between the two; so the samples of a pixel are split where their inverse depths leave a gap.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

NOWHERE = -1.0
"""A boundary that no inverse depth is below: the split is not used."""


@dataclass(frozen=True)
class DepthSurvey:
    """What the samples of a list of pixels see.

    pixels: int64 [pixel].
    bounds: float32 [pixel, surface - 1], falling: a sample whose inverse depth is below n of them belongs to
        the n-th surface of its pixel, 0 being the nearest.
    tops: float32 [pixel, surface], the nearest sample of each surface.
    farthest: float32 [pixel]. Where a pixel has fewer surfaces, the rest is NOWHERE. Pixels where no sample
        sees anything are left out.
    """

    pixels: np.ndarray
    bounds: np.ndarray
    tops: np.ndarray
    farthest: np.ndarray

    @property
    def several(self) -> np.ndarray:
        """bool [pixel]: more than one surface."""
        return self.bounds[:, 0] != NOWHERE if self.bounds.shape[1] else np.zeros(len(self.pixels), bool)


def survey(tiles: Iterator[tuple[np.ndarray, np.ndarray]], gap: float, surfaces: int) -> DepthSurvey:
    """Find the surfaces that each pixel sees.

    tiles: (pixels [pixel], inverse depths float32 [pixel, sample], NaN where a sample sees nothing).
    gap: of inverse depth, in 1/m, that parts two surfaces.
    surfaces: at most this many a pixel.
    """
    pixels = [np.zeros(0, np.int64)]
    bounds = [np.zeros((0, surfaces - 1), np.float32)]
    tops = [np.zeros((0, surfaces), np.float32)]
    farthest = [np.zeros(0, np.float32)]
    for chosen, inverse_depth in tiles:
        sees = ~np.isnan(inverse_depth).all(axis=1)
        inverse_depth = inverse_depth[sees]
        pixels.append(chosen[sees])
        farthest.append(np.fmin.reduce(inverse_depth, axis=1))
        bounds.append(np.full((len(inverse_depth), surfaces - 1), NOWHERE, np.float32))
        tops.append(np.full((len(inverse_depth), surfaces), NOWHERE, np.float32))
        tops[-1][:, 0] = np.fmax.reduce(inverse_depth, axis=1)
        wide = tops[-1][:, 0] - farthest[-1] > gap
        if surfaces > 1 and wide.any():
            bounds[-1][wide], tops[-1][wide, 1:] = split(inverse_depth[wide], gap, surfaces)
    return DepthSurvey(*(np.concatenate(parts) for parts in (pixels, bounds, tops, farthest)))


def unparted(pixels: np.ndarray) -> DepthSurvey:
    """Pixels that are taken to see one surface each, at depths that nobody asked for: all NOWHERE.

    pixels: [pixel], numbers.
    """
    nothing = np.full((len(pixels), 1), NOWHERE, np.float32)
    return DepthSurvey(pixels, nothing[:, :0], nothing, nothing[:, 0])


def split(inverse_depth: np.ndarray, gap: float, surfaces: int) -> tuple[np.ndarray, np.ndarray]:
    """Boundaries between surfaces, and the inverse depth of the nearest sample behind each: float32
    [pixel, surfaces - 1] each, falling, NOWHERE if unused.

    inverse_depth: float32 [pixel, sample], NaN where a sample sees nothing. Splits at the widest gaps, so
    that where there are too many surfaces the closest ones are taken together.
    """
    ordered = np.sort(inverse_depth, axis=1)  # NaN last
    steps = np.diff(ordered, axis=1)
    steps = np.where(steps > gap, steps, 0.0)
    count = min(surfaces - 1, steps.shape[1])
    widest = np.argsort(-steps, axis=1, kind="stable")[:, :count]
    used = np.take_along_axis(steps, widest, axis=1) > 0
    below = np.where(used, np.take_along_axis(ordered, widest, axis=1), NOWHERE)
    above = np.where(used, np.take_along_axis(ordered, widest + 1, axis=1), NOWHERE)
    falling = np.argsort(-below, axis=1, kind="stable")
    bounds, tops = np.full((2, len(inverse_depth), surfaces - 1), NOWHERE, np.float32)
    bounds[:, :count] = np.take_along_axis(0.5 * (below + above), falling, axis=1)
    tops[:, :count] = np.take_along_axis(below, falling, axis=1)
    return bounds, tops
