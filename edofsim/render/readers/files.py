"""Sources of views that are read: pictures with a depth map, and spectral cubes."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import model_validator

from ...recipe.base import Positive
from ...recipe.scene import SceneRecipe
from ...recipe.sources import CubeFile, DepthMap
from ...scene import spectra
from ...scene.cubes import read_cube
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


class CubeSource(ViewReader, CubeFile):
    """A spectral cube: a folder with one picture a band (in the order of the numbers in the names), ENVI (its
    .hdr), a MAT or HDF5 file, NPY, a TIFF with a page a band, or an EXR of the spectral layout. At `depth_m`,
    or with a depth map."""

    kind: Literal["cube"]
    depth_m: Positive | None = None
    """distance of the whole picture, m; or give `depth`"""
    depth: DepthMap | None = None
    """depth map of the picture"""

    @model_validator(mode="after")
    def _one_depth(self) -> CubeSource:
        if (self.depth_m is None) == (self.depth is None):
            raise ValueError("give depth_m or a [source.depth] table, one of the two")
        return self

    def view(self, recipe: SceneRecipe, base: Path) -> View:
        """The cube's middle as one fragment a pixel. At one depth nothing can be hidden, and the view says
        so."""
        cube, said = read_cube(self, base, recipe.bands.wavelengths())
        shape = (cube.shape[1], cube.shape[2])
        if self.depth is None:
            assert self.depth_m is not None  # the model holds one of the two
            inverse, facts = np.full(shape, 1 / self.depth_m), {"hidden": "none: no depth edge"}
        else:
            left, top, right, bottom = self.crop
            whole = (shape[0] + top + bottom, shape[1] + left + right)
            inverse, facts = depths(self.depth, base, whole)
            inverse = inverse[top : whole[0] - bottom, left : whole[1] - right]
        rows, columns, border = frame_indices(shape, recipe)
        radiance = np.ascontiguousarray(cube[:, rows[:, None], columns[None]])
        facts = {**facts, "cube": f"{self.path}: {said}", "beyond the border": border}
        if self.illuminant is not None:
            facts |= light_entry(spectra.illuminant(self.illuminant, recipe.bands.wavelengths()))
        inverse = inverse[np.ix_(rows, columns)]
        return plain_view(recipe, radiance, inverse, "read from a spectral cube", facts)
