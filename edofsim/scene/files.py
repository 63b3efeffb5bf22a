"""The files that a scene recipe reads, so that a cache notices when one of them changes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ..recipe.base import RecipeModel
from ..recipe.lights import EnvironmentMap
from ..recipe.scene import SceneRecipe
from ..recipe.sources import CubeSource, DepthMap, MitsubaSource, RgbdSource
from ..recipe.surfaces import FileTexture
from ..recipe.things import MeshFile

SKIMAGE = "skimage:"
"""Prefix of pictures and depths that come with scikit-image."""


def files_of(recipe: SceneRecipe, base: Path) -> tuple[Path, ...]:
    """Every file (folders: their files, a Mitsuba scene: all that it names) that building or reading the
    scene will open, sorted, each once. Files that do not exist are named too: reading them tells the user.
    """
    found: set[Path] = set()
    for item in _models(recipe):
        if isinstance(item, FileTexture | MeshFile | EnvironmentMap | DepthMap | CubeSource):
            found |= _inside(Path(base), item.path)
        elif isinstance(item, RgbdSource):
            found |= _inside(Path(base), item.image)
        elif isinstance(item, MitsubaSource):
            from .foreign import files_of_scene

            found |= set(files_of_scene(item, Path(base)))
    return tuple(sorted(found))


def _inside(base: Path, name: str) -> set[Path]:
    if name.startswith(SKIMAGE):
        return set()
    path = base / name
    return {p for p in path.iterdir() if p.is_file()} if path.is_dir() else {path}


def _models(value: Any):
    if isinstance(value, RecipeModel):
        yield value
        for name in type(value).model_fields:
            yield from _models(getattr(value, name))
    elif isinstance(value, tuple | list):
        for item in value:
            yield from _models(item)
