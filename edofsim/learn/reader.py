"""Readers of training data: from a table of the recipe to scenes that can be photographed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Protocol

import torch

from ..core.json_values import Json
from ..recipe.train import TrainingSource, TrainRecipe
from .system import Scenes
from .training_camera import TrainingCamera


class Source(Protocol):
    """One kind of data. `described` goes into the card; `sha256` names its bytes."""

    @property
    def described(self) -> Json: ...

    @property
    def sha256(self) -> str: ...

    def draw(self, count: int, generator: torch.Generator) -> Scenes:
        """`count` random scenes."""

    def validation(self, count: int) -> list[Scenes]:
        """The same scenes each time, `count` of them in batches, none of which is ever drawn."""


@dataclass(frozen=True)
class Wanted:
    """What data are read for.

    optics: with the mask's height map as it is at the start.
    base: where relative files start.
    data: the folder given with --data.
    cache: of rendered views, which are rendered where they are missing.
    for_validation: nothing of the source is trained on.
    """

    recipe: TrainRecipe
    optics: TrainingCamera
    base: Path
    data: Path | None
    cache: Path | None = None
    progress: Callable[[float, str], None] | None = None
    for_validation: bool = False


class TrainingReader(TrainingSource):
    """A table that names training data. A new one is a class in a file of its own.

    slow: opening it takes long. It is opened after the others, so that bad input of theirs ends at once.
    """

    slow: ClassVar[bool] = False

    def open(self, wanted: Wanted) -> Source:
        """The data, read. Raises InputError for what cannot be used.

        wanted: what the data are read for.
        """
        raise NotImplementedError
