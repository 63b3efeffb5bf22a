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

    pixels: int64 [pixel]; bounds: float32 [pixel, split], falling: a sample whose inverse depth is below
    n of them belongs to the n-th surface of its pixel, the nearest being 0; nearest, farthest: float32
    [pixel], of those samples that see anything (pixels where none does are left out).
    """

    pixels: np.ndarray
    bounds: np.ndarray
    nearest: np.ndarray
    farthest: np.ndarray

    @property
    def several(self) -> np.ndarray:
        """bool [pixel]: more than one surface."""
        return self.bounds[:, 0] != NOWHERE if self.bounds.shape[1] else np.zeros(len(self.pixels), bool)


def survey(tiles: Iterator[tuple[np.ndarray, np.ndarray]], gap: float, surfaces: int) -> DepthSurvey:
    """Find the surfaces that each pixel sees.

    tiles: (pixels [pixel], inverse depths float32 [pixel, sample], NaN where a sample sees nothing). gap: of
    inverse depth, in 1/m, that parts two surfaces; surfaces: at most so many a pixel.
    """
    parts = []
    for pixels, inverse_depth in tiles:
        sees = ~np.isnan(inverse_depth).all(axis=1)
        pixels, inverse_depth = pixels[sees], inverse_depth[sees]
        nearest, farthest = np.fmax.reduce(inverse_depth, axis=1), np.fmin.reduce(inverse_depth, axis=1)
        bounds = np.full((len(pixels), surfaces - 1), NOWHERE, np.float32)
        wide = nearest - farthest > gap
        if surfaces > 1 and wide.any():
            bounds[wide] = split(inverse_depth[wide], gap, surfaces)
        parts.append((pixels, bounds, nearest, farthest))
    if not parts:
        return DepthSurvey(
            np.zeros(0, np.int64), np.zeros((0, surfaces - 1), np.float32), *np.zeros((2, 0), np.float32)
        )
    return DepthSurvey(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def split(inverse_depth: np.ndarray, gap: float, surfaces: int) -> np.ndarray:
    """Boundaries between surfaces, float32 [pixel, surfaces - 1], falling, NOWHERE if unused.

    inverse_depth: float32 [pixel, sample], NaN where a sample sees nothing. Splits at the widest gaps, so
    that where there are too many surfaces the closest ones are taken together.
    """
    ordered = np.sort(inverse_depth, axis=1)  # NaN last
    steps = np.diff(ordered, axis=1)
    steps = np.where(steps > gap, steps, 0.0)
    count = min(surfaces - 1, steps.shape[1])
    widest = np.argsort(-steps, axis=1, kind="stable")[:, :count]
    used = np.take_along_axis(steps, widest, axis=1) > 0
    below, above = (
        np.take_along_axis(ordered, widest, axis=1),
        np.take_along_axis(ordered, widest + 1, axis=1),
    )
    bounds = np.where(used, 0.5 * (below + above), NOWHERE).astype(np.float32)
    out = np.full((len(inverse_depth), surfaces - 1), NOWHERE, np.float32)
    out[:, :count] = -np.sort(-bounds, axis=1)
    return out
