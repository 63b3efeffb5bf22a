"""Readers of scenes that are rendered after they were read."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

import numpy as np

from ..recipe.sources import Source
from .model import SceneModel


class SceneReader(Source):
    """A source of meshes, surfaces and lights. A new one is a class in a file of its own."""

    rendered: ClassVar[bool] = True

    def scene(self, base: Path, wavelengths: np.ndarray, name: str) -> SceneModel:
        """The scene called `name` in camera space, at `wavelengths` [band] in metres.

        base: the folder of the recipe.
        wavelengths: [band], metres.

        Raises InputError for files that cannot be used.
        """
        raise NotImplementedError
