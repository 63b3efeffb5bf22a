"""Photographs as planes at one depth: the paper's training data."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Literal

import torch
from pydantic import Field, ValidationInfo, model_validator

from ..capture.planes import surroundings
from ..core.json_values import Json
from ..errors import InputError
from ..recipe.base import renamed
from ..recipe.train import Range, TrainRecipe
from .edges import Edges, draw_covers
from .highlights import with_highlights
from .reader import TrainingReader, Wanted
from .sources import Images, central_patches, draw_patches, packaged_images, read_folder, split
from .system import Planes, Scenes
from .training_camera import MIDDLE
from .variation import Variation, evenly, varied

VALIDATION_BATCH = 4


class Photographs(TrainingReader):
    """What all sources of photographs have."""

    edges: Annotated[float, Field(ge=0, le=1)] = 0.0
    """share of the steps with a depth edge in each patch: one photograph in front of another"""
    saturated_highlights: Annotated[float, Field(ge=0, le=1)] = 0.0
    """share of the patches with highlights far beyond full scale"""
    broadband: Annotated[float, Field(ge=0, le=1)] = 0.0
    """share of the steps in which the sensor sees all wavelengths, in place of three lines"""
    vary: Variation = Variation()
    """how exposure and colours vary"""
    inverse_depth_per_m: Range | None = None
    """range of inverse depths, 1/m, in place of that of `capture`"""

    @model_validator(mode="before")
    @classmethod
    def _old_names(cls, data: object, info: ValidationInfo) -> object:
        return renamed(data, "lamps", "saturated_highlights", {}, info) if isinstance(data, Mapping) else data


class NaturalImages(Photographs):
    """Photographs in a folder, each as a plane at one depth: the paper's training. 8-bit values are taken
    as intensities, as the paper does. In half of the steps with saturated highlights the photo is clipped at
    full scale. In broadband steps light has the smoothest spectra of these colours, in a few wavelengths
    which are drawn anew in each step."""

    kind: Literal["natural"] = "natural"
    folder: str | None = None
    """folder of photographs, relative to the recipe's; without it the one of --data"""

    def open(self, wanted: Wanted) -> PlaneSource:
        folder = wanted.data if self.folder is None else wanted.base / self.folder
        if folder is None:
            raise InputError("this recipe trains on photographs of your own; name the folder: --data DIR")
        images = read_folder(folder, wanted.recipe.data.patch_px)
        return plane_source(self, images, folder.name, wanted.recipe, wanted.optics.window)


class PackagedImages(Photographs):
    """The photographs that come with scikit-image, as planes at one depth: always at hand."""

    kind: Literal["packaged"] = "packaged"

    def open(self, wanted: Wanted) -> PlaneSource:
        images = packaged_images(wanted.recipe.data.patch_px)
        return plane_source(self, images, "skimage.data", wanted.recipe, wanted.optics.window)


@dataclass(frozen=True)
class PlaneSource:
    """Photographs as planes, uniform in inverse depth between `depths` (low, high) in 1/m; in a share `edges`
    of the steps each one is in front of another, and a share of them has saturated highlights.

    broadband: share of the steps, and of validation.
    vary: of exposure and colours, of which validation has the exposures next to the pictures as they are.
    """

    training: Images
    held_back: Images
    patch: int
    window: int
    depths: tuple[float, float]
    described: Json
    sha256: str
    edges: float = 0.0
    saturated_highlights: float = 0.0
    broadband: float = 0.0
    vary: Variation = Variation()

    def draw(self, count: int, generator: torch.Generator) -> Scenes:
        low, high = self.depths
        around = surroundings(self.window)
        sharp, means, places = draw_patches(self.training, count, self.patch, around, generator)
        depths = low + (high - low) * torch.rand(count, generator=generator)
        if self.vary.changes:
            sharp, means = varied(sharp, means, self.vary, generator)
        saturates = False
        if self.saturated_highlights > 0:
            sharp = with_highlights(sharp, self.saturated_highlights, generator)
            saturates = float(torch.rand((), generator=generator)) < 0.5
        broadband = self.broadband > 0 and float(torch.rand((), generator=generator)) < self.broadband
        shift = float(torch.rand((), generator=generator)) if broadband else MIDDLE
        how = {
            "mean": means,
            "saturates": saturates,
            "broadband": broadband,
            "places": places,
            "shift": shift,
        }
        planes = Planes(sharp, depths, **how)
        if self.edges == 0:
            return planes
        depths = depths.sort().values  # as the parts of a step share their PSFs
        if count == 1 or float(torch.rand((), generator=generator)) >= self.edges:
            return replace(planes, inverse_depths=depths)
        covers = draw_covers(count, sharp.shape[-1], generator)
        return Edges(sharp, covers, depths, **how)

    def validation(self, count: int) -> list[Scenes]:
        sharp, means, places = central_patches(self.held_back, count, self.patch, surroundings(self.window))
        if self.vary.changes:
            dim, dim_means = evenly(sharp, means, self.vary)
            sharp, means = torch.cat([sharp, dim]), torch.cat([means, dim_means])
            places = torch.cat([places, places])
            count *= 2
        depths = torch.linspace(*self.depths, count)
        # neighbouring pictures of a folder are alike: walk through the depths in strides
        depths = depths[torch.arange(count) * _stride(count) % count]
        step = VALIDATION_BATCH
        parts = [slice(i, i + step) for i in range(0, count, step)]
        lines = [float(index) >= self.broadband * len(parts) for index in range(len(parts))]
        return [
            Planes(sharp[part], depths[part], mean=means[part], broadband=not line, places=places[part])
            for part, line in zip(parts, lines, strict=True)
        ]


def _stride(count: int) -> int:
    """A step of about 0.4 of the way round that visits every one of `count` places."""
    step = max(1, round(0.4 * count))
    while torch.gcd(torch.tensor(step), torch.tensor(count)) != 1:
        step += 1
    return step


def plane_source(
    table: Photographs, images: Images, name: str, recipe: TrainRecipe, window: int, *, whole: bool = False
) -> PlaneSource:
    """Photographs as a source that scenes are drawn from, a part of them held back for validation.

    whole: all are for both.
    """
    parts = (images, images) if whole else split(images, recipe.data.validation, recipe.seed)
    training, held_back = parts
    described = {
        "kind": table.kind,
        "name": name,
        "training": len(training.pictures),
        "validation": len(held_back.pictures),
        "sha256": images.sha256,
    }
    return PlaneSource(
        training,
        held_back,
        recipe.data.patch_px,
        window,
        table.inverse_depth_per_m or recipe.capture.inverse_depth_per_m,
        described,
        images.sha256,
        table.edges,
        table.saturated_highlights,
        table.broadband,
        table.vary,
    )
