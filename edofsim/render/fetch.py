"""From a recipe to its view: out of the cache, or rendered and stored there."""

from __future__ import annotations

import json
import logging
import platform
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from ..core.json_values import Json
from ..core.progress import Progress, part, silent
from ..recipe.scene import SceneRecipe
from ..record import writable_folder
from ..scene import build_scene
from ..scene.foreign import NotCarried
from . import cache as store
from .colour import lit
from .engine import find_engines
from .fragments import Fragments
from .keys import canonical, says_path_length, view_key
from .rendering import render_foreign, render_model
from .settings import RenderSettings

if TYPE_CHECKING:
    from .view import View

LOG = logging.getLogger(__name__)


@dataclass(frozen=True)
class Fetched:
    """What gives a view, as it is read; where it lives, how long this call rendered (0 if it came from the
    cache), and the view's samples and noise."""

    view: Callable[[], View]
    place: store.Place
    seconds: float
    samples: int
    noise: float


def _found(fragments: Fragments, place: store.Place, recipe: SceneRecipe, base: Path) -> Fetched:
    return Fetched(
        lambda: _view(lit(fragments, recipe, base)), place, 0.0, _samples(fragments), fragments.noise
    )


def stored_view(place: store.Place, recipe: SceneRecipe, base: Path) -> View | None:
    """The view of a recipe if it is in the cache. Raises InputError for files that cannot be used."""
    known = store.load(place, aside=False)[0]
    return None if known is None else _view(lit(known, recipe, base))


def _view(fragments: Fragments) -> View:
    from .view import View  # PyTorch takes a second: rendering does without

    return View.of(fragments)


def _samples(view: View | Fragments) -> int:
    return int(view.metadata.get("samples", 0))


def is_picture(recipe: SceneRecipe) -> bool:
    """Whether a recipe's view is read, not rendered: a picture with depths, or a spectral cube."""
    return recipe.source is not None and not recipe.source.rendered


def place_of(recipe: SceneRecipe, base: Path, cache: Path | None, noise: float | None) -> store.Place:
    """Where the view of a recipe lives, whether or not it is there yet."""
    return store.Place(cache or store.default_folder(), recipe.name, view_key(recipe, base, noise))


def fetch(
    recipe: SceneRecipe,
    base: Path,
    cache: Path | None,
    noise: float | None,
    device: str,
    progress: Progress | None,
) -> Fetched:
    """See `edofsim.render.render`."""
    say = progress or silent
    place = place_of(recipe, base, cache, noise)
    if is_picture(recipe):
        from .readers import picture_view

        # Read faster than the cache could be.
        picture = picture_view(recipe, base)
        return Fetched(lambda: picture, place, 0.0, _samples(picture), picture.noise)
    # Without the lock first: readers of a finished view never wait for each other, and need not write.
    known, _ = store.load(place, aside=False)
    if known is not None:
        return _found(known, place, recipe, base)
    writable_folder(place.folder, store.OPTION)
    with store.locked(place, lambda: say(0.0, "another process renders this view; waiting for it")):
        known, message = store.load(place, aside=True)
        if known is not None:
            return _found(known, place, recipe, base)
        if message:
            LOG.warning(message)
        start = time.perf_counter()
        fresh, stored = _rendered(recipe, base, place, noise, device, say)
        seconds = time.perf_counter() - start
        return Fetched(lambda: _view(stored()), place, seconds, _samples(fresh), fresh.noise)


def _rendered(
    recipe: SceneRecipe, base: Path, place: store.Place, noise: float | None, device: str, say: Progress
) -> tuple[Fragments, Callable[[], Fragments]]:
    """A view's fragments, and what gives them as they are read."""

    start = time.perf_counter()
    settings = RenderSettings.from_recipe(recipe, noise)
    partial = place.file("partial")
    how = {"device": device, "progress": say, "partial": partial}
    try:
        with ThreadPoolExecutor(1) as thread:
            thread.submit(find_engines)  # the first time on a machine it waits for a child process
            model = build_scene(recipe, base, part(say, 0.0, 0.0))
    except NotCarried as reasons:
        LOG.warning(
            "%s goes through Mitsuba's spectral variant: %s", recipe.name, "; ".join(reasons.problems)
        )
        view = render_foreign(recipe, base, settings, reasons.problems, **how)
    else:
        if model.path_length is not None and not says_path_length(recipe):
            settings = replace(settings, max_depth=model.path_length)
        view = render_model(model, settings, **how)
    run = {**view.metadata["run"], "host": platform.node(), "total_seconds": time.perf_counter() - start}
    rows, columns = settings.padded_shape
    record = {
        "samples": view.metadata["samples"],
        "noise": view.noise,
        "pixels": rows * columns,
        "bands": view.bands,
        "run": run,
    }
    view = lit(view, recipe, base)
    stored = store.store(place, view, canonical(recipe), record)
    partial.unlink(missing_ok=True)
    return view, stored


def run_of(recipe: SceneRecipe, base: Path, cache: Path | None = None) -> Json | None:
    """What the entry of a view says of its rendering (`seconds` by stage, `last_pass_seconds`, `threads`,
    `host`); None where it does not say."""
    try:
        text = place_of(recipe, base, cache, None).file("json").read_text(encoding="utf-8")
        return dict(json.loads(text)["run"])
    except (OSError, ValueError, KeyError, TypeError):
        return None
