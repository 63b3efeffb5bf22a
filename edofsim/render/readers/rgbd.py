"""Pictures with a depth map."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np

from ...core.images import srgb_decode, unit_rgb
from ...recipe.base import Positive
from ...recipe.scene import SceneRecipe
from ...recipe.sources import DepthMap
from ...scene import depth_maps, spectra
from ..view import View
from .pictures import ViewReader, depths, frame_indices, plain_view


class RgbdSource(ViewReader):
    """An sRGB picture with a depth map. Its colours become smooth reflectances under `illuminant`.

    `image` is a file, or `skimage:NAME` for a picture that comes with scikit-image (and so is the depth's
    `path`). One pixel of the picture becomes one pixel of the frame, whatever angle it saw when it was
    taken; the middle of the picture is the middle of the frame."""

    kind: Literal["rgbd"]
    image: str
    """picture, relative to the recipe's folder, or skimage:NAME"""
    depth: DepthMap
    """depth map of the picture"""
    illuminant: str = "D65"
    """spectrum that its colours are seen under: a CIE illuminant"""
    radiance: Positive = 1.0
    """radiance of white, W/m2/sr/nm"""

    def view(self, recipe: SceneRecipe, base: Path) -> View:
        """Radiance is the colours' smooth spectra (Mallett and Yuksel, EGSR 2019) under the illuminant."""
        picture = depth_maps.read_numbers(self.image, None, base, "picture")
        linear = srgb_decode(unit_rgb(picture))
        inverse, facts = depths(self.depth, base, linear.shape[:2])
        rows, columns, border = frame_indices(linear.shape[:2], recipe)
        colours = linear[np.ix_(rows, columns)]
        radiance = spectra.upsampled(self.radiance * colours, recipe.bands.wavelengths(), self.illuminant)
        facts = {**facts, "beyond the border": border, "light": f"sRGB under {self.illuminant}"}
        return plain_view(
            recipe, radiance, inverse[np.ix_(rows, columns)], "read from a picture with depths", facts
        )
