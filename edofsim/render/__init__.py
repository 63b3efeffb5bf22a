"""Rendering: a scene recipe becomes a view, from the cache if it was rendered before."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from ..core.progress import Progress
from ..recipe.scene import SceneRecipe
from .fetch import fetch, is_picture, place_of, stored_view
from .jobs import Forecast, RenderOutcome, Task, forecast, render_many
from .keys import view_key

if TYPE_CHECKING:
    from .view import View

__all__ = [
    "Forecast",
    "RenderOutcome",
    "Task",
    "cached",
    "finished",
    "forecast",
    "render",
    "render_many",
    "view_key",
]


def render(
    recipe: SceneRecipe,
    base: Path,
    *,
    cache: Path | None = None,
    noise: float | None = None,
    device: str = "auto",
    progress: Progress | None = None,
) -> View:
    """The view of a scene: read from the cache, or rendered and stored there.

    base: folder that files named in the recipe start from.
    cache: folder of views, None for the default one.
    noise: relative standard error to render to, instead of the recipe's number of samples.
    device: auto, cpu or cuda. Interrupted work is kept in the cache and gone on from.

    Raises InputError for a scene or a folder that cannot be used, EngineError where nothing can render,
    EdofsimError if the disk is full.
    """
    return fetch(recipe, base, cache, noise, device, progress).view()


def cached(
    recipe: SceneRecipe, base: Path, *, cache: Path | None = None, noise: float | None = None
) -> View | None:
    """The view of a scene if it is in the cache."""
    return stored_view(place_of(recipe, base, cache, noise), recipe, base)


def finished(
    recipe: SceneRecipe, base: Path, *, cache: Path | None = None, noise: float | None = None
) -> View | None:
    """The view of a scene if nothing has to be rendered for it: it is in the cache, or a picture with depths
    or a spectral cube, which is read. Raises InputError for files that cannot be used."""
    if is_picture(recipe):
        return fetch(recipe, base, cache, noise, "cpu", None).view()
    return cached(recipe, base, cache=cache, noise=noise)
