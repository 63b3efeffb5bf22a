"""Where fragments are in space, and the rays of pixels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from ..render.view import View


@dataclass(frozen=True)
class Crop:
    """A part of a view's frame in pixels: rows top to top + height, columns left to left + width."""

    top: int
    left: int
    height: int
    width: int


def pixel_directions(
    view: View,
    crop: Crop,
    margin: int,
    pixel: np.ndarray,
    shift: tuple[float | np.ndarray, float | np.ndarray] = (0.0, 0.0),
) -> np.ndarray:
    """(x/z, y/z, 1) of pixels of a cropped view, float64 [n, 3].

    view: the whole one.
    pixel: [n], numbers in the crop's frame with its margin.
    shift: (down, right) from the pixels' centres, in pixels, for all or each [n].

    Raises InputError for a view through a lens that distorts.
    """
    if view.metadata.get("chief_rays"):
        raise InputError(
            "the references look through a pinhole, and this view was rendered along the chief rays of a lens"
            " that distorts; render it for a camera whose lens does not"
        )
    columns = crop.width + 2 * margin
    row = pixel // columns - margin + crop.top + shift[0]
    column = pixel % columns - margin + crop.left + shift[1]
    x = (column + 0.5 - view.width / 2) * view.pixel_angle
    y = (view.height / 2 - row - 0.5) * view.pixel_angle
    return np.stack([x, y, np.ones_like(x)], axis=1)
