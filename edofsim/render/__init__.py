"""Rendering: a scene recipe becomes a view, from the cache if it was rendered before."""

from __future__ import annotations

import logging
import platform
import time
from collections.abc import Callable
from pathlib import Path

from ..recipe.scene import SceneRecipe
from . import cache as store
from .keys import canonical, view_key
from .settings import RenderSettings
from .view import View

LOG = logging.getLogger(__name__)

__all__ = ["View", "cached", "render", "view_key"]


def render(
    recipe: SceneRecipe,
    base: Path,
    *,
    cache: Path | None = None,
    noise: float | None = None,
    device: str = "auto",
    progress: Callable[[float, str], None] | None = None,
) -> View:
    """The view of a scene: read from the cache, or rendered and stored there.

    base: folder that files named in the recipe start from. cache: folder of views, None for the default one.
    noise: relative standard error to render to, instead of the recipe's number of samples. device: auto, cpu
    or cuda. Interrupted work is kept in the cache and gone on from. Raises InputError for a scene or a folder
    that cannot be used, EngineError where nothing can render, EdofsimError if the disk is full.
    """
    say = progress or (lambda fraction, message: None)
    place = _place(recipe, base, cache, noise)
    store.open_folder(place.folder)
    # Without the lock first: readers of a finished view never wait for each other.
    view, _ = store.load(place, aside=False)
    if view is not None:
        return view
    with store.locked(place, lambda: say(0.0, "another process renders this view; waiting for it")):
        view, message = store.load(place, aside=True)
        if view is not None:
            return view
        if message:
            LOG.warning(message)
        return _rendered(recipe, base, place, noise, device, say)


def cached(
    recipe: SceneRecipe, base: Path, *, cache: Path | None = None, noise: float | None = None
) -> View | None:
    """The view of a scene if it is in the cache."""
    place = _place(recipe, base, cache, noise)
    return store.load(place, aside=False)[0]


def _place(recipe: SceneRecipe, base: Path, cache: Path | None, noise: float | None) -> store.Place:
    return store.Place(cache or store.default_folder(), recipe.name, view_key(recipe, base, noise))


def _rendered(
    recipe: SceneRecipe,
    base: Path,
    place: store.Place,
    noise: float | None,
    device: str,
    say: Callable[[float, str], None],
) -> View:
    from ..scene import build_scene
    from .rendering import render_model

    start = time.perf_counter()
    say(0.0, "building the scene")
    model = build_scene(recipe, base)
    partial = place.file("partial")
    view = render_model(
        model, RenderSettings.from_recipe(recipe, noise), device=device, progress=say, partial=partial
    )
    run = {**view.metadata["run"], "host": platform.node(), "total_seconds": time.perf_counter() - start}
    record = {"samples": view.metadata["samples"], "noise": view.noise, "run": run}
    stored = store.store(place, view, canonical(recipe), record)
    partial.unlink(missing_ok=True)
    return stored
