"""Many views: workers on this machine or on a Dask cluster, a forecast before, a manifest after.

All state is in the cache: what was finished is not rendered again, what was interrupted is gone on from.
"""

from __future__ import annotations

import math
import platform
import shutil
import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ..core.progress import Progress, silent
from ..core.words import counted, duration
from ..errors import EdofsimError, InputError
from ..record import writable_folder
from ..scene import build_scene
from ..scene.foreign import NotCarried
from . import cache as store
from .batch import RenderOutcome, Task, batch, note, rendered
from .engine import thread_count
from .fetch import fetch, is_picture, place_of
from .settings import RenderSettings
from .spread import shard_of

SECONDS_A_SAMPLE, SECONDS_A_VIEW = 5e-6, 5.0
"""Of one thread, and for building, loading and compiling: for a forecast on a machine that has rendered
nothing yet; from then on its own times count."""

BYTES_A_VALUE = 2.6
"""Of a view's file, per pixel and band, likewise: half float, ZIP, and some fragments more than pixels."""

MANIFEST = "manifest.jsonl"


@dataclass(frozen=True)
class Forecast:
    """What rendering will take.

    pictures: views that are read, not rendered.
    seconds: of the whole batch.
    bytes: of new files.
    free: on the disk.
    measured: whether it rests on views that this machine rendered into this cache.
    """

    views: int
    in_cache: int
    seconds: float
    bytes: int
    free: int
    measured: bool
    pictures: int = 0

    def __str__(self) -> str:
        todo = self.views - self.in_cache - self.pictures
        found = f"{counted(self.views, 'view')}, {self.in_cache} of them in the cache"
        if self.pictures:
            found += f", {self.pictures} read from pictures"
        if not todo:
            return f"{found}; nothing to render"
        basis = (
            "from the times of earlier views"
            if self.measured
            else "a rough guess: nothing was rendered here yet"
        )
        return (
            f"{found}; {todo} to render: about "
            f"{duration(self.seconds)} and {self.bytes / 2**20:.0f} MiB of {self.free / 2**30:.1f} GiB "
            f"free ({basis})"
        )


def forecast(
    tasks: Sequence[Task], *, cache: Path | None = None, jobs: int = 1, noise: float | None = None
) -> Forecast:
    """Time and disk that rendering would take. A noise to reach is counted as the recipe's samples."""
    folder = cache or store.default_folder()
    per_sample, per_view, per_value, measured = _rates(folder)
    seconds = size = 0.0
    in_cache = pictures = 0
    for task in tasks:
        if is_picture(task.recipe):
            pictures += 1
            continue
        if place_of(task.recipe, task.base, cache, task.stops_at(noise)).file("exr").is_file():
            in_cache += 1
            continue
        settings = RenderSettings.from_recipe(task.recipe)
        pixels = settings.padded_shape[0] * settings.padded_shape[1]
        seconds += pixels * settings.samples * per_sample / thread_count() + per_view / jobs
        size += pixels * task.recipe.bands.count * per_value
    if in_cache + pictures < len(tasks):
        writable_folder(folder, store.OPTION)
    free = shutil.disk_usage(folder).free if folder.is_dir() else 0
    return Forecast(len(tasks), in_cache, seconds, math.ceil(size), free, measured, pictures)


def check_scenes(tasks: Sequence[Task], progress: Progress | None = None) -> None:
    """Build what has to be built and read what has to be read, before any time goes into rendering.

    Raises InputError with the problems of all scenes."""

    problems: list[str] = []
    for number, task in enumerate(tasks):
        if progress is not None:
            progress(0.0, f"looking through the scenes, {number + 1} of {len(tasks)}")
        try:
            if is_picture(task.recipe):
                fetch(task.recipe, task.base, None, None, "cpu", None)
            else:
                build_scene(task.recipe, task.base)
        except NotCarried:
            continue
        except InputError as error:
            problems += [p if task.recipe.name in p else f"{task.recipe.name}: {p}" for p in error.problems]
    if problems:
        raise InputError(problems)


def _rates(folder: Path) -> tuple[float, float, float, bool]:
    """Thread seconds a sample, seconds a view in addition, and bytes a value, of what this machine rendered
    before."""
    host = platform.node()
    works: list[tuple[int, int, float, float]] = []
    sizes: list[float] = []
    for entry in store.ls(folder)[:200]:
        try:
            record = entry.record
            if record["run"]["host"] == host:
                run, count = record["run"], record["pixels"] * record["samples"]
                works.append((count, run["threads"], run["seconds"]["paths"], run["total_seconds"]))
            sizes.append(record["bytes"] / record["pixels"] / record["bands"])
        except (KeyError, TypeError, ZeroDivisionError):
            continue
    per_sample, per_view = SECONDS_A_SAMPLE, SECONDS_A_VIEW
    if works:  # large views tell what a sample takes; what small ones take in addition is their set-up
        per_sample = sum(paths * threads for _, threads, paths, _ in works) / sum(work[0] for work in works)
        per_view = statistics.median(
            max(0.0, total - count * per_sample / threads) for count, threads, _, total in works
        )
    return per_sample, per_view, statistics.median(sizes) if sizes else BYTES_A_VALUE, bool(works)


def render_many(
    tasks: Sequence[Task],
    *,
    cache: Path | None = None,
    jobs: int = 1,
    cluster: str | None = None,
    shard: tuple[int, int] | None = None,
    noise: float | None = None,
    device: str = "auto",
    manifest: Path | None = None,
    progress: Progress | None = None,
) -> list[RenderOutcome]:
    """Render all tasks that are not in the cache, in any order; outcomes are in theirs.

    jobs, cluster, shard: see `Spread`.
    manifest: JSON-lines file that gets a line a finished view, by default `manifest.jsonl` in the cache.

    A view that fails is an outcome with an error, and the others go on. Raises InputError for a shard or
    folder that cannot be used, EngineError where nothing can render, EdofsimError if the disk is too small or
    full.
    """
    say = progress or silent
    tasks = shard_of(tasks, shard)
    folder = cache or store.default_folder()
    expected = forecast(tasks, cache=cache, jobs=jobs, noise=noise)
    if expected.bytes > expected.free:
        raise EdofsimError(f"The disk of {folder} is too small for this: {expected}")
    say(0.0, str(expected))
    workers = batch(tasks, folder, noise, device, manifest or folder / MANIFEST, say)
    return workers.run(jobs, cluster)


def render_one(
    task: Task,
    *,
    cache: Path | None = None,
    noise: float | None = None,
    device: str = "auto",
    progress: Progress | None = None,
) -> RenderOutcome:
    """One task in this process: no worker is started. Raises what `edofsim.render.render` raises."""
    outcome = rendered(task, progress, cache, noise, device)
    note((cache or store.default_folder()) / MANIFEST, outcome)
    return outcome
