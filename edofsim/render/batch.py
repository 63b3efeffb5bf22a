"""Views of a batch: what a worker renders, and what becomes of it."""

from __future__ import annotations

import json
import math
import platform
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path

from ..core.files import append_line
from ..core.progress import Progress
from ..errors import EdofsimError
from ..recipe.scene import SceneRecipe
from .fetch import fetch, is_picture, place_of
from .spread import Workers


@dataclass(frozen=True)
class Task:
    """A recipe and the folder that files named in it start from.

    noise: relative, to stop at; None for that of all tasks.
    """

    recipe: SceneRecipe
    base: Path
    noise: float | None = None

    def stops_at(self, noise: float | None) -> float | None:
        """The noise to stop at.

        noise: that of all tasks.
        """
        return noise if self.noise is None else self.noise


@dataclass(frozen=True)
class RenderOutcome:
    """What became of a task.

    seconds: of rendering, 0 if it was in the cache.
    error: empty if all went well.
    origin: of a view that is not fresh, `cache`, or `file` where it is read from the scene's own.
    """

    name: str
    key: str
    seconds: float
    samples: int
    noise: float
    host: str
    fresh: bool
    error: str = ""
    origin: str = "cache"


def note(manifest: Path, outcome: RenderOutcome) -> None:
    """A line of the manifest. One on a view that was there already may be missing: its folder may be such
    that it can only be read."""
    line = json.dumps({"time": time.time(), **asdict(outcome)}, sort_keys=True)
    try:
        append_line(manifest, line)
    except EdofsimError:
        if outcome.fresh:
            raise


def batch(
    tasks: Sequence[Task], folder: Path, noise: float | None, device: str, manifest: Path, say: Progress
) -> Workers[Task, RenderOutcome]:
    """The workers of tasks, whose views go into the folder."""

    def failed(number: int, error: EdofsimError) -> RenderOutcome:
        task = tasks[number]
        key = place_of(task.recipe, task.base, folder, task.stops_at(noise)).key
        return RenderOutcome(task.recipe.name, key, 0.0, 0, math.nan, platform.node(), False, str(error))

    work = partial(rendered, folder=folder, noise=noise, device=device)
    return Workers(tasks, work, failed, say, partial(note, manifest), "views")


def rendered(
    task: Task,
    progress: Progress | None,
    folder: Path | None = None,
    noise: float | None = None,
    device: str = "auto",
) -> RenderOutcome:
    """One task in this process."""
    found = fetch(task.recipe, task.base, folder, task.stops_at(noise), device, progress)
    return RenderOutcome(
        task.recipe.name,
        found.place.key,
        found.seconds,
        found.samples,
        found.noise,
        platform.node(),
        found.seconds > 0,
        origin="file" if is_picture(task.recipe) else "cache",
    )
