"""What a training sees: the recipe's sources, mixed by their weights."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import torch

from ..capture.planes import surroundings
from ..core.progress import Progress
from ..errors import InputError
from ..recipe.train import NaturalImages, PackagedImages, TrainRecipe, Views
from .edges import Edges, draw_covers
from .lamps import with_lamps
from .sources import Images, central_patches, draw_patches, packaged_images, read_folder, split
from .system import Optics, Planes, Scenes
from .views import open_views

VALIDATION_BATCH = 4


class Source(Protocol):
    """One kind of data. `described` goes into the card; `sha256` names its bytes."""

    described: dict[str, Any]
    sha256: str

    def draw(self, count: int, generator: torch.Generator) -> Scenes:
        """`count` random scenes."""

    def validation(self, count: int) -> list[Scenes]:
        """The same scenes each time, `count` of them in batches, none of which is ever drawn."""


@dataclass(frozen=True)
class Material:
    """All sources; `validation` holds scenes that are never trained on."""

    sources: tuple[Source, ...]
    weights: tuple[float, ...]
    validation: tuple[Scenes, ...]
    described: tuple[dict[str, Any], ...]
    sha256: str

    def draw(self, count: int, generator: torch.Generator) -> Scenes:
        """A batch from one source, chosen by weight."""
        index = 0
        if len(self.sources) > 1:
            index = int(torch.multinomial(torch.tensor(self.weights), 1, generator=generator))
        return self.sources[index].draw(count, generator)


@dataclass(frozen=True)
class PlaneSource:
    """Photographs as planes, uniform in inverse depth between `depths` (low, high) in 1/m; in a share `edges`
    of the steps each one is in front of another, and a share `lamps` of them has lamps."""

    training: Images
    held_back: Images
    patch: int
    window: int
    depths: tuple[float, float]
    described: dict[str, Any]
    sha256: str
    edges: float = 0.0
    lamps: float = 0.0

    def draw(self, count: int, generator: torch.Generator) -> Scenes:
        low, high = self.depths
        sharp, means = draw_patches(self.training, count, self.patch, surroundings(self.window), generator)
        depths = low + (high - low) * torch.rand(count, generator=generator)
        saturates = False
        if self.lamps > 0:
            sharp = with_lamps(sharp, self.lamps, generator)
            saturates = float(torch.rand((), generator=generator)) < 0.5
        if self.edges == 0:
            return Planes(sharp, depths, mean=means, saturates=saturates)
        depths = depths.sort().values  # as the parts of a step share their PSFs
        if count == 1 or float(torch.rand((), generator=generator)) >= self.edges:
            return Planes(sharp, depths, mean=means, saturates=saturates)
        covers = draw_covers(count, sharp.shape[-1], generator)
        return Edges(sharp, covers, depths, mean=means, saturates=saturates)

    def validation(self, count: int) -> list[Scenes]:
        sharp, means = central_patches(self.held_back, count, self.patch, surroundings(self.window))
        depths = torch.linspace(*self.depths, count)
        # neighbouring pictures of a folder are alike: walk through the depths in strides
        depths = depths[torch.arange(count) * _stride(count) % count]
        step = VALIDATION_BATCH
        parts = [slice(i, i + step) for i in range(0, count, step)]
        return [Planes(sharp[part], depths[part], mean=means[part]) for part in parts]


def _stride(count: int) -> int:
    """A step of about 0.4 of the way round that visits every one of `count` places."""
    step = max(1, round(0.4 * count))
    while torch.gcd(torch.tensor(step), torch.tensor(count)) != 1:
        step += 1
    return step


def gather(
    recipe: TrainRecipe,
    optics: Optics,
    base: Path,
    data: Path | None,
    cache: Path | None = None,
    progress: Progress | None = None,
) -> Material:
    """Read all sources of a recipe. base: where its relative folders start; data: the folder for sources that
    name none; cache: of rendered views, which are rendered where they are missing.

    Raises InputError for folders and scenes that cannot be used.
    """
    sources: list[Source] = []
    for table in recipe.data.sources:
        if isinstance(table, Views):
            patch, share = recipe.data.patch_px, recipe.data.validation
            sources.append(open_views(table, patch, share, optics, base, cache, progress))
        else:
            sources.append(_planes(recipe, table, optics.window, base, data))
    share = -(-recipe.data.validation_patches // len(sources))
    validation = [scenes for source in sources for scenes in source.validation(share)]
    weights = tuple(table.weight for table in recipe.data.sources)
    digest = hashlib.sha256("".join(source.sha256 for source in sources).encode()).hexdigest()
    return Material(tuple(sources), weights, tuple(validation), _descriptions(sources), digest)


def _planes(
    recipe: TrainRecipe, table: NaturalImages | PackagedImages, window: int, base: Path, data: Path | None
) -> PlaneSource:
    patch = recipe.data.patch_px
    if isinstance(table, PackagedImages):
        images, name = packaged_images(patch), "skimage.data"
    else:
        folder = data if table.folder is None else base / table.folder
        if folder is None:
            raise InputError("this recipe trains on photographs of your own; name the folder: --data DIR")
        images, name = read_folder(folder, patch), folder.name
    training, held_back = split(images, recipe.data.validation, recipe.seed)
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
        patch,
        window,
        recipe.capture.inverse_depth_per_m,
        described,
        images.sha256,
        table.edges,
        table.lamps,
    )


def _descriptions(sources: Sequence[Source]) -> tuple[dict[str, Any], ...]:
    return tuple(source.described for source in sources)
