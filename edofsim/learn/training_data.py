"""What a training sees: the recipe's sources, mixed by their weights."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import torch

from ..core.json_values import Json
from ..core.progress import Progress
from ..recipe.train import TrainRecipe
from .reader import Source, TrainingReader, Wanted
from .system import Scenes
from .training_camera import TrainingCamera


@dataclass(frozen=True)
class TrainingData:
    """All sources; `validation` holds scenes that are never trained on, under the name of their source: its
    number in the recipe, from 1 on, and its kind."""

    sources: tuple[Source, ...]
    weights: tuple[float, ...]
    validation: tuple[tuple[str, Scenes], ...]
    described: tuple[Json, ...]
    sha256: str

    def draw(self, count: int, generator: torch.Generator) -> Scenes:
        """A batch from one source, chosen by weight."""
        index = 0
        if len(self.sources) > 1:
            index = int(torch.multinomial(torch.tensor(self.weights), 1, generator=generator))
        return self.sources[index].draw(count, generator)


def gather(
    recipe: TrainRecipe,
    optics: TrainingCamera,
    base: Path,
    data: Path | None,
    cache: Path | None = None,
    progress: Progress | None = None,
) -> TrainingData:
    """Read all sources of a recipe.

    base: where its relative folders start.
    data: the folder for sources that name none.
    cache: of rendered views, which are rendered where they are missing.

    Raises InputError for folders and scenes that cannot be used.
    """
    tables = (*recipe.data.sources, *recipe.data.validation_sources)
    trained = len(recipe.data.sources)
    readers = [table for table in tables if isinstance(table, TrainingReader)]
    assert len(readers) == len(tables)  # the registry holds no other
    opened: dict[int, Source] = {}
    for index in sorted(range(len(readers)), key=lambda index: readers[index].slow):
        wanted = Wanted(recipe, optics, base, data, cache, progress, for_validation=index >= trained)
        opened[index] = readers[index].open(wanted)
    sources = [opened[index] for index in range(len(readers))]
    return mixed(recipe, sources)


def mixed(recipe: TrainRecipe, sources: Sequence[Source]) -> TrainingData:
    """Sources that were opened: those of the recipe, and then those for validation alone."""
    tables = (*recipe.data.sources, *recipe.data.validation_sources)
    trained = len(recipe.data.sources)
    share = -(-recipe.data.validation_patches // len(sources))
    validation = [
        (f"{number}-{table.kind}", scenes)
        for number, (table, source) in enumerate(zip(tables, sources, strict=True), start=1)
        for scenes in source.validation(share)
    ]
    weights = tuple(table.weight for table in recipe.data.sources)
    digest = hashlib.sha256("".join(source.sha256 for source in sources).encode()).hexdigest()
    described = [
        {**source.described, "only": "validation"} if index >= trained else source.described
        for index, source in enumerate(sources)
    ]
    return TrainingData(tuple(sources[:trained]), weights, tuple(validation), tuple(described), digest)
