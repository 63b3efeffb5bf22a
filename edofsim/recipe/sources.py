"""What the readers of scenes have in common: depth maps, and the files of spectral cubes.

Files are relative to the recipe's folder.
"""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field, model_validator

from .base import Positive, RecipeModel
from .kinds import SOURCES, KindModel, OfKind

Pixels = Annotated[int, Field(ge=0)]


class DepthMap(RecipeModel):
    """A file of depths (PNG, TIFF, PFM, NPY, NPZ, MAT, EXR or Sintel's DPT), or of disparities with their
    stereo calibration.

    `holds` says what the numbers are, after they are multiplied by `unit`: depth along the axis in metres,
    its inverse in 1/m, or disparity in pixels, of which depth = baseline focal / (disparity + offset).
    NaN, negative values, and a depth of 0 are holes, as is a disparity that is not finite; an infinite depth
    is background. Where a `disparity_offset_px` is given, negative disparities are depths as well, those that
    it makes positive. `scale` stretches the scene along the axis.
    """

    path: str
    """file of the depths, relative to the recipe's folder"""
    key: str | None = None
    """array in an NPZ or MAT (dots go into its structures), or channel of an EXR; None: the only one, or Z"""
    holds: Literal["depth", "inverse_depth", "disparity"] = "depth"
    """what the numbers are after `unit`: depth in m, inverse depth in 1/m, or disparity in pixels"""
    unit: Positive = 1.0
    """factor on the file's numbers"""
    scale: Positive = 1.0
    """factor that stretches the scene along the axis"""
    focal_length_px: Positive | None = None
    """focal length of the stereo pair, pixels, for disparities"""
    baseline_mm: Positive | None = None
    """distance of the stereo cameras, mm, for disparities"""
    disparity_offset_px: float = 0.0
    """disparity that is added, pixels"""
    holes: Literal["background", "nearest", "refuse"] = "background"
    """what fills them: the farther of the neighbours in the row, the nearest known pixel, or nothing"""

    @model_validator(mode="after")
    def _calibrated(self) -> DepthMap:
        if self.holds == "disparity" and (self.focal_length_px is None or self.baseline_mm is None):
            raise ValueError('holds = "disparity" needs focal_length_px and baseline_mm')
        return self


class Source(KindModel):
    """What a scene is read from. rendered: whether that is a scene which has yet to be rendered."""

    rendered: ClassVar[bool]


class CubeFile(RecipeModel):
    """A spectral cube: a folder with one picture a band (in the order of the names), a MAT file, or an EXR
    of the spectral layout."""

    path: str
    """folder with a picture a band, MAT file or spectral EXR, relative to the recipe's folder"""
    key: str | None = None
    """array in a MAT file; dots go into its structures"""
    start_nm: Positive | None = None
    """wavelength of the first band, nm, where the file does not say"""
    step_nm: Positive | None = None
    """distance between bands, nm, where the file does not say"""
    illuminant: str | None = None
    """None: the cube holds radiance; else it holds reflectances that are seen under this light"""
    scale: Positive | Literal["auto"] = "auto"
    """factor from the file's numbers; `auto` puts the 99th percentile of the mean over bands at 1"""
    crop: tuple[Pixels, Pixels, Pixels, Pixels] = (0, 0, 0, 0)
    """pixels to cut off at the left, top, right, bottom"""

    @model_validator(mode="after")
    def _both(self) -> CubeFile:
        if (self.start_nm is None) != (self.step_nm is None):
            raise ValueError("start_nm and step_nm belong together")
        return self


AnySource = Annotated[Source, OfKind(SOURCES)]
