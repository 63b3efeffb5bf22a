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
from .system import Optics, Scenes


@dataclass(frozen=True)
class Material:
    """All sources; `validation` holds scenes that are never trained on."""

    sources: tuple[Source, ...]
    weights: tuple[float, ...]
    validation: tuple[Scenes, ...]
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
    wanted = Wanted(recipe, optics, base, data, cache, progress)
    for table in recipe.data.sources:
        assert isinstance(table, TrainingReader)  # what the registry holds
        sources.append(table.open(wanted))
    share = -(-recipe.data.validation_patches // len(sources))
    validation = [scenes for source in sources for scenes in source.validation(share)]
    weights = tuple(table.weight for table in recipe.data.sources)
    digest = hashlib.sha256("".join(source.sha256 for source in sources).encode()).hexdigest()
    return Material(tuple(sources), weights, tuple(validation), _descriptions(sources), digest)


def _descriptions(sources: Sequence[Source]) -> tuple[Json, ...]:
    return tuple(source.described for source in sources)
