"""Pictures with a depth map."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np

from ...recipe.base import Positive
from ...recipe.scene import SceneRecipe
from ...recipe.sources import DepthMap
from ...scene import spectra
from ...scene.pictures import source_picture
from ..colour import light_entry
from ..view import View
from .pictures import ViewReader, depths, frame_indices, plain_view


class RgbdSource(ViewReader):
    """A picture with a depth map. Its colours become smooth reflectances under `illuminant`.

    `image` is a file (PNG, JPEG, TIFF, OpenEXR, PFM, Radiance; of an OpenEXR with several layers,
    `image_layer` says which), or `skimage:NAME` for a picture that comes with scikit-image (and so is the
    depth's `path`). One pixel of the picture becomes one pixel of the frame, whatever angle it saw when it
    was taken; the middle of the picture is the middle of the frame."""

    kind: Literal["rgbd"]
    image: str
    """picture, relative to the recipe's folder, or skimage:NAME"""
    image_layer: str | None = None
    """layer of an OpenEXR file; None: its channels R, G, B, or the only layer with such"""
    depth: DepthMap
    """depth map of the picture"""
    illuminant: str = "D65"
    """spectrum that its colours are seen under: a CIE illuminant"""
    radiance: Positive = 1.0
    """radiance of white, W/m2/sr/nm"""

    def view(self, recipe: SceneRecipe, base: Path) -> View:
        """Radiance is the colours' smooth spectra (Mallett and Yuksel, EGSR 2019) under the illuminant."""
        picture = source_picture(self.image, self.image_layer, base)
        linear = picture.linear
        inverse, facts = depths(self.depth, base, (linear.shape[0], linear.shape[1]))
        facts["picture"] = f"{self.image}: {'; '.join(picture.assumed)}"
        rows, columns, border = frame_indices(linear.shape[:2], recipe)
        colours = linear[np.ix_(rows, columns)]
        radiance = spectra.upsampled(self.radiance * colours, recipe.bands.wavelengths(), self.illuminant)
        facts = {**facts, "beyond the border": border, "light": f"sRGB under {self.illuminant}"}
        facts |= light_entry(spectra.illuminant(self.illuminant, recipe.bands.wavelengths()))
        return plain_view(
            recipe, radiance, inverse[np.ix_(rows, columns)], "read from a picture with depths", facts
        )
