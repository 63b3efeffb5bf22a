"""A reader: a light field of a row of cameras, seen from the middle one, with depths by matching.

The file is an .npz with `pictures`, linear radiance [camera, y, x], and `baseline_mm` between neighbours. The
pictures are moved by each of a few disparities; the one is taken by which they agree best with the middle
picture, and the depth of a disparity of d pixels of tangent p is baseline / (d p).
"""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np

from edofsim import InputError, View
from edofsim.plugins import SceneRecipe, ViewReader, frame_indices, plain_view


class LightField(ViewReader):
    """A light field of a row of cameras, as an .npz; grey, so that all bands are alike."""

    kind: Literal["light-field"]
    path: str
    largest_disparity_px: int = 8

    def view(self, recipe: SceneRecipe, base: Path) -> View:
        try:
            with np.load(base / self.path) as file:
                pictures, baseline = file["pictures"], float(file["baseline_mm"]) * 1e-3
        except (OSError, KeyError, ValueError) as error:
            raise InputError(f"light field {self.path!r}: {error}") from None
        middle = len(pictures) // 2
        errors = []
        for disparity in range(self.largest_disparity_px + 1):
            moved = [np.roll(each, (k - middle) * disparity, 1) for k, each in enumerate(pictures)]
            errors.append(sum(np.square(each - pictures[middle]) for each in moved))
        disparity = np.argmin(errors, axis=0)
        inverse = disparity * recipe.frame.pixel_angle_mrad * 1e-3 / baseline
        rows, columns, border = frame_indices(inverse.shape, recipe)
        place = np.ix_(rows, columns)
        seen = pictures[middle][place].astype(np.float32)
        radiance = np.repeat(seen[None], recipe.bands.count, axis=0)
        return plain_view(
            recipe, radiance, inverse[place], "read from a light field", {"beyond the border": border}
        )
