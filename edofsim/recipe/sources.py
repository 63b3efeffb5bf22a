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
    """A file of depths (PNG, TIFF, PFM, NPY, NPZ, MAT, HDF5, EXR, CSV or Sintel's DPT), or of disparities
    with their stereo calibration.

    `holds` says what the numbers are, after they are multiplied by `unit` and `offset` is added: depth along
    the axis in metres, its inverse in 1/m, or disparity in pixels, of which depth = baseline focal /
    (disparity + offset). `relative_inverse_depth` is inverse depth up to a factor and an offset, as networks
    that see one picture give it: the largest number lies at `near_m`, the smallest at `far_m`.
    NaN, negative values, and a depth of 0 are holes, as is a disparity that is not finite; an infinite depth
    is background. Where an offset is given, negative numbers are depths as well, those that it makes
    positive; of relative numbers all that are finite are. `scale` stretches the scene along the axis.
    """

    path: str
    """file of the depths, relative to the recipe's folder"""
    key: str | None = None
    """array in an NPZ, MAT or HDF5 (dots go into its structures), or channel of an EXR; None: the only one,
    or Z"""
    holds: Literal["depth", "inverse_depth", "relative_inverse_depth", "disparity"] = "depth"
    """what the numbers are after `unit` and `offset`: depth in m, inverse depth in 1/m or up to a factor and
    an offset, or disparity in pixels"""
    unit: Positive = 1.0
    """factor on the file's numbers"""
    offset: float = 0.0
    """what is added to them after that"""
    scale: Positive = 1.0
    """factor that stretches the scene along the axis"""
    near_m: Positive | None = None
    """distance of the largest relative inverse depth, m"""
    far_m: Positive | None = None
    """distance of the smallest relative inverse depth, m"""
    focal_length_px: Positive | None = None
    """focal length of the stereo pair, pixels, for disparities"""
    baseline_mm: Positive | None = None
    """distance of the stereo cameras, mm, for disparities"""
    disparity_offset_px: float = 0.0
    """disparity that is added, pixels"""
    resize: bool = False
    """whether a map of another size, but the same proportions, is brought to the picture's: each pixel takes
    the nearest number, so that no depth arises that is not in the file"""
    holes: Literal["background", "nearest", "refuse"] = "background"
    """what fills them: the farther of the neighbours in the row, the nearest known pixel, or nothing"""

    @model_validator(mode="after")
    def _calibrated(self) -> DepthMap:
        if self.holds == "disparity" and (self.focal_length_px is None or self.baseline_mm is None):
            raise ValueError('holds = "disparity" needs focal_length_px and baseline_mm')
        relative = self.holds == "relative_inverse_depth"
        if relative and (self.near_m is None or self.far_m is None):
            raise ValueError(f'holds = "{self.holds}" needs two known distances, near_m and far_m')
        if not relative and not (self.near_m is None and self.far_m is None):
            raise ValueError('near_m and far_m are for holds = "relative_inverse_depth"')
        if self.near_m is not None and self.far_m is not None and not self.near_m < self.far_m:
            raise ValueError("near_m must be less than far_m")
        return self


class Source(KindModel):
    """What a scene is read from. rendered: whether that is a scene which has yet to be rendered."""

    rendered: ClassVar[bool]


class CubeFile(RecipeModel):
    """A spectral cube: a folder with one picture a band (in the order of the numbers in the names), ENVI (its
    .hdr), a MAT or HDF5 file, NPY, a TIFF with a page a band, or an EXR of the spectral layout.

    Wavelengths come from `wavelengths_nm`, from `start_nm` and `step_nm`, or from the file: its header, a
    list that is called so, or names such as 415nm.png. Bands may be in any order, evenly spaced or not."""

    path: str
    """folder with a picture a band, or file, relative to the recipe's folder"""
    key: str | None = None
    """array in a MAT or HDF5 file; dots go into its structures"""
    start_nm: Positive | None = None
    """wavelength of the first band, nm, where the file does not say"""
    step_nm: Annotated[float, Field(allow_inf_nan=False)] | None = None
    """distance between bands, nm, where the file does not say; below 0 where they descend"""
    wavelengths_nm: tuple[Positive, ...] | None = None
    """wavelength of each band, nm, in the file's order, where the file does not say"""
    wavelength_unit: Literal["nm", "um", "angstrom", "m"] | None = None
    """of the wavelengths in the file; None: as the file says, else by their size where that leaves no
    doubt"""
    bands: Literal["first", "last"] | None = None
    """which axis of an array they are; None: the last, but in NPY and HDF5 the first where it alone has as
    many as there are wavelengths, or is less than half of both others"""
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
        if self.wavelengths_nm is not None and self.start_nm is not None:
            raise ValueError("give wavelengths_nm, or start_nm and step_nm")
        if self.step_nm == 0:
            raise ValueError("step_nm must not be 0")
        return self


AnySource = Annotated[Source, OfKind(SOURCES)]
