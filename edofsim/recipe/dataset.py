"""The dataset recipe: which scenes are photographed by which cameras, and how the pairs are kept."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from ..core.json_values import Json
from .base import NotNegative, Positive, RecipeModel
from .train import CamerasTable

Split = Literal["train", "validation", "test"]
SPLITS: tuple[Split, ...] = ("train", "validation", "test")


class DatasetScene(RecipeModel):
    """A scene, or members of its family. Each member is in one split with all its photos."""

    recipe: str
    """scene recipe: a file, a shipped name, or that of a shipped family such as `kitchen`"""
    members: Annotated[int, Field(ge=0, le=1_000_000)] = 0
    """members of its family; 0: the scene itself"""
    seed: Annotated[int, Field(ge=0, lt=1 << 31)] | None = None
    """seed of the first member; without it the scene recipe's"""
    split: Split | None = None
    """split of all of it; without it the last members are for validation and test, as `splits` says"""


class DatasetFrame(RecipeModel):
    """The pixels of all views, in place of the scenes' own."""

    width_px: Annotated[int, Field(ge=16, le=4096)] = 256
    """width, pixels"""
    height_px: Annotated[int, Field(ge=16, le=4096)] = 256
    """height, pixels"""
    samples: Annotated[int, Field(ge=1, le=1 << 16)] | None = None
    """light paths a pixel; without it the scene recipe's"""


class DatasetPhotos(RecipeModel):
    """What varies from photo to photo."""

    exposure: tuple[Positive, Positive] = (1.0, 1.0)
    """range of factors on the camera's exposure, drawn evenly in their logarithm"""
    read_noise: tuple[NotNegative, NotNegative] | None = None
    """range of the read noise, drawn evenly, relative to full scale; without it the camera's"""
    noise_seeds: Annotated[int, Field(ge=1, le=1000)] = 1
    """photos of each scene by each camera that differ in the sensor's noise alone"""
    saturation: bool = False
    """whether sensors are full at full scale, whatever their recipes say"""
    fidelity: Json | None = None
    """fields of a `Fidelity` that all photos are simulated with; without it each has a plan"""
    accuracy: str | None = None
    """what plans aim for, as `--accuracy` of `expose`"""
    rendering_noise: bool = False
    """whether to keep what two halves of the samples differ by, so that scores are without that noise"""

    @model_validator(mode="after")
    def _one_way(self) -> DatasetPhotos:
        if self.fidelity is not None and self.accuracy is not None:
            raise ValueError("fidelity says all that is simulated: leave out accuracy")
        for name in ("exposure", "read_noise"):
            ends = getattr(self, name)
            if ends is not None and ends[1] < ends[0]:
                raise ValueError(f"{name} must ascend, not go from {ends[0]:g} to {ends[1]:g}")
        return self


class DatasetSplits(RecipeModel):
    """Shares of each family's members, the last of them."""

    validation: Annotated[float, Field(ge=0, lt=1)] = 0.1
    """share for validation"""
    test: Annotated[float, Field(ge=0, lt=1)] = 0.1
    """share for test, the very last"""


class DatasetStore(RecipeModel):
    """How the pairs are kept."""

    kind: Literal["folder", "png", "webdataset", "zarr"] = "folder"
    """"folder": an OpenEXR file a pair; "png": also 8-bit sRGB pictures of photo and truth; "webdataset": tar
    files; "zarr": one Zarr group"""
    shard: Annotated[int, Field(ge=1, le=100_000)] = 256
    """pairs in a tar file, or in a file of a Zarr array"""
    precision: Literal["half", "float"] = "half"
    """of images: "half": 16 bits, "float": 32"""
    keep_views: bool = False
    """whether rendered views stay, to be photographed by other cameras"""


class DatasetRecipe(RecipeModel):
    """A dataset recipe: pairs of a photo and the sharp image that it should become."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]*$", max_length=64)]
    """name of the data: letters, digits, _ and -, at most 64"""
    purpose: str = ""
    """what the data are for, in a sentence"""
    version: Literal[1] = 1
    """version of what the keys of this file mean"""
    seed: Annotated[int, Field(ge=0, lt=1 << 31)] = 0
    """seed of exposures, noise and drawn cameras"""
    scenes: Annotated[tuple[DatasetScene, ...], Field(min_length=1)]
    """the scenes"""
    cameras: tuple[str, ...] = ()
    """cameras that photograph every scene: files or shipped names"""
    drawn: CamerasTable | None = None
    """random cameras, of which each scene gets one in turn: `count` of them"""
    frame: DatasetFrame = DatasetFrame()
    """pixels of the views"""
    photos: DatasetPhotos = DatasetPhotos()
    """what varies from photo to photo"""
    splits: DatasetSplits = DatasetSplits()
    """shares for validation and test"""
    store: DatasetStore = DatasetStore()
    """how the pairs are kept"""

    @model_validator(mode="after")
    def _has_cameras(self) -> DatasetRecipe:
        if not self.cameras and self.drawn is None:
            raise ValueError("name `cameras`, or give a table [drawn]")
        return self
