"""Many views: workers on this machine or on a Dask cluster, a forecast before, a manifest after.

One function renders one recipe, given to a `concurrent.futures` executor. Workers are spawned, and recycled
after a few views because Mitsuba's memory grows when scenes are loaded again and again. All state is in the
cache: what was finished is not rendered again, what was interrupted is gone on from.
"""

from __future__ import annotations

import json
import math
import multiprocessing
import platform
import queue
import shutil
import statistics
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from ..errors import EdofsimError, EngineError, InputError
from ..recipe.scene import SceneRecipe
from . import cache as store
from .engine import set_threads, thread_count
from .fetch import fetch, place_of
from .settings import RenderSettings

Progress = Callable[[float, str], None]

VIEWS_A_WORKER = 8
SECONDS_A_SAMPLE = 5e-6
"""Of one thread, for a forecast on a machine that has rendered nothing yet; from then on its own times
count."""

BYTES_A_VALUE = 2.6
"""Of a view's file, per pixel and band, likewise: half float, ZIP, and some fragments more than pixels."""

MANIFEST = "manifest.jsonl"


@dataclass(frozen=True)
class Task:
    """A recipe and the folder that files named in it start from."""

    recipe: SceneRecipe
    base: Path


@dataclass(frozen=True)
class Outcome:
    """What became of a task. seconds: of rendering, 0 if it was in the cache; error: empty if all went
    well."""

    name: str
    key: str
    seconds: float
    samples: int
    noise: float
    host: str
    fresh: bool
    error: str = ""


@dataclass(frozen=True)
class Forecast:
    """What rendering will take. seconds: of the whole batch; bytes: of new files; free: on the disk;
    measured: whether it rests on views that this machine rendered into this cache."""

    views: int
    in_cache: int
    seconds: float
    bytes: int
    free: int
    measured: bool

    def __str__(self) -> str:
        todo = self.views - self.in_cache
        basis = (
            "from the times of earlier views"
            if self.measured
            else "a rough guess: nothing was rendered here yet"
        )
        return (
            f"{self.views} views, {self.in_cache} of them in the cache; {todo} to render: about "
            f"{_duration(self.seconds)} and {self.bytes / 2**20:.0f} MiB of {self.free / 2**30:.1f} GiB "
            f"free ({basis})"
        )


def _duration(seconds: float) -> str:
    if seconds < 120:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 7200 else f"{seconds / 3600:.1f} h"


def shard_of(tasks: Sequence[Task], shard: tuple[int, int] | None) -> list[Task]:
    """Every n-th task, beginning with the i-th, for shard (i, n) with i from 1 to n.

    Raises InputError for a shard that does not exist."""
    if shard is None:
        return list(tasks)
    number, count = shard
    if not 1 <= number <= count:
        raise InputError(
            f"there is no shard {number}/{count}: the first of {count} is 1/{count}, the last {count}/{count}"
        )
    return list(tasks[number - 1 :: count])


def forecast(
    tasks: Sequence[Task], *, cache: Path | None = None, jobs: int = 1, noise: float | None = None
) -> Forecast:
    """Time and disk that rendering would take. A noise to reach is counted as the recipe's samples."""
    folder = cache or store.default_folder()
    store.open_folder(folder)
    per_sample, per_value, measured = _rates(folder)
    seconds = size = 0.0
    in_cache = 0
    for task in tasks:
        if place_of(task.recipe, task.base, cache, noise).file("exr").is_file():
            in_cache += 1
            continue
        settings = RenderSettings.from_recipe(task.recipe)
        pixels = settings.padded_shape[0] * settings.padded_shape[1]
        seconds += pixels * settings.samples * per_sample / thread_count()
        size += pixels * task.recipe.bands.count * per_value
    free = shutil.disk_usage(folder).free
    return Forecast(len(tasks), in_cache, seconds, math.ceil(size), free, measured)


def _rates(folder: Path) -> tuple[float, float, bool]:
    """Thread seconds a sample and bytes a value, medians over what this machine rendered before."""
    host = platform.node()
    seconds, sizes = [], []
    for entry in store.ls(folder)[:200]:
        try:
            record = entry.record
            if record["run"]["host"] == host:
                count = record["pixels"] * record["samples"]
                seconds.append(record["run"]["total_seconds"] * record["run"]["threads"] / count)
            sizes.append(record["bytes"] / record["pixels"] / record["bands"])
        except (KeyError, TypeError, ZeroDivisionError):
            continue
    return (
        statistics.median(seconds) if seconds else SECONDS_A_SAMPLE,
        statistics.median(sizes) if sizes else BYTES_A_VALUE,
        bool(seconds),
    )


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
) -> list[Outcome]:
    """Render all tasks that are not in the cache, in any order; outcomes are in theirs.

    jobs: worker processes, which share the processors; cluster: address of a Dask scheduler whose workers see
    the same files, instead. shard: (i, n), for one of n runs that share the work. manifest: JSON-lines file
    that gets a line a finished view, by default `manifest.jsonl` in the cache. A view that fails is an
    outcome with an error, and the others go on. Raises InputError for a shard or folder that cannot be used,
    EngineError where nothing can render, EdofsimError if the disk is too small or full.
    """
    say = progress or (lambda fraction, message: None)
    tasks = shard_of(tasks, shard)
    folder = cache or store.default_folder()
    expected = forecast(tasks, cache=cache, jobs=jobs, noise=noise)
    if expected.bytes > expected.free:
        raise EdofsimError(f"The disk of {folder} is too small for this: {expected}")
    say(0.0, str(expected))
    batch = _Batch(tasks, folder, noise, device, manifest or folder / MANIFEST, say)
    try:
        with _executor(jobs, cluster, batch) as executor:
            batch.run(executor)
        if batch.lost:
            # A worker died, most often for want of memory, and took the pool with it: once more, one by one.
            with _executor(1, cluster, batch) as executor:
                batch.run(executor, last=True)
    finally:
        batch.close()
    return [batch.outcomes[number] for number in range(len(tasks))]


def render_one(
    task: Task,
    *,
    cache: Path | None = None,
    noise: float | None = None,
    device: str = "auto",
    progress: Progress | None = None,
) -> Outcome:
    """One task in this process: no worker is started. Raises what `edofsim.render.render` raises."""
    outcome = _rendered(task, cache, noise, device, progress)
    _note((cache or store.default_folder()) / MANIFEST, outcome)
    return outcome


def _note(manifest: Path, outcome: Outcome) -> None:
    line = json.dumps({"time": time.time(), **asdict(outcome)}, sort_keys=True) + "\n"
    manifest.parent.mkdir(parents=True, exist_ok=True)  # a picture with depths needs no cache folder
    with manifest.open("a", encoding="utf-8") as file:
        file.write(line)


class _Batch:
    """Tasks in flight and their outcomes."""

    def __init__(
        self, tasks: list[Task], folder: Path, noise: float | None, device: str, manifest: Path, say: Progress
    ) -> None:
        self.tasks, self.folder, self.noise, self.device, self.manifest = (
            tasks,
            folder,
            noise,
            device,
            manifest,
        )
        self.say = say
        self.outcomes: dict[int, Outcome] = {}
        self.lost: list[int] = []
        self.parts: dict[int, float] = {}
        self.messages: Any = None
        self.started = time.perf_counter()

    def run(self, executor: Executor, last: bool = False) -> None:
        """Submit what has no outcome yet and wait for it."""
        self.lost = []
        waiting = {
            executor.submit(_work, number, task, self.folder, self.noise, self.device): number
            for number, task in enumerate(self.tasks)
            if number not in self.outcomes
        }
        try:
            while waiting:
                done, _ = wait(waiting, timeout=0.5, return_when=FIRST_COMPLETED)
                for future in done:
                    self._take(waiting.pop(future), future, last)
                self._tell()
        except BaseException:
            for future in waiting:
                future.cancel()
            raise

    def _take(self, number: int, future: Future, last: bool) -> None:
        task = self.tasks[number]
        try:
            outcome = future.result()
        except (store.DiskFullError, EngineError):
            raise
        except BrokenProcessPool:
            if not last:
                self.lost.append(number)
                return
            outcome = self._failed(
                task, "its worker died, most likely for want of memory; render it with fewer --jobs"
            )
        except EdofsimError as error:
            outcome = self._failed(task, str(error))
        self.outcomes[number] = outcome
        self.parts[number] = 1.0
        _note(self.manifest, outcome)

    def _failed(self, task: Task, error: str) -> Outcome:
        key = place_of(task.recipe, task.base, self.folder, self.noise).key
        return Outcome(task.recipe.name, key, 0.0, 0, math.nan, platform.node(), False, error)

    def _tell(self) -> None:
        while self.messages is not None:
            try:
                number, part = self.messages.get_nowait()
            except queue.Empty:
                break
            self.parts[number] = max(part, self.parts.get(number, 0.0))
        fraction = sum(self.parts.values()) / max(1, len(self.tasks))
        spent = time.perf_counter() - self.started
        left = f", {_duration(spent * (1 - fraction) / fraction)} left" if fraction > 0.02 else ""
        self.say(fraction, f"{len(self.outcomes)} of {len(self.tasks)} views{left}")

    def close(self) -> None:
        """Let go of the queue."""
        if self.messages is not None:
            self.messages.close()


@contextmanager
def _executor(jobs: int, cluster: str | None, batch: _Batch) -> Iterator[Executor]:
    if cluster is not None:
        with _dask(cluster) as executor:
            yield executor
        return
    context = multiprocessing.get_context("spawn")
    batch.messages = batch.messages or context.Queue()
    threads = max(1, thread_count() // jobs)
    executor = ProcessPoolExecutor(
        jobs, context, _start_worker, (threads, batch.messages), max_tasks_per_child=VIEWS_A_WORKER
    )
    try:
        yield executor
    finally:
        # Workers get Ctrl-C too, and save their sums; wait for them.
        executor.shutdown(wait=True, cancel_futures=True)


@contextmanager
def _dask(address: str) -> Iterator[Executor]:
    try:
        from distributed import Client
    except ImportError as error:
        raise InputError("--cluster needs Dask: pip install 'edofsim[cluster]'") from error
    try:
        client = Client(address, timeout="20s")
    except (OSError, ValueError) as error:
        raise InputError(f"no Dask scheduler answers at {address}: {error}") from error
    with client:
        yield client.get_executor(pure=False)


_messages: Any = None
_one_at_a_time = threading.Lock()


def _start_worker(threads: int, messages: Any) -> None:
    global _messages
    _messages = messages
    set_threads(threads)


def _work(number: int, task: Task, folder: Path, noise: float | None, device: str) -> Outcome:
    """Render one task: what every worker runs."""
    last = 0.0

    def tell(fraction: float, message: str) -> None:
        nonlocal last
        if _messages is not None and time.monotonic() - last > 0.5:
            last = time.monotonic()
            _messages.put((number, min(fraction, 0.99)))

    # A Dask worker has several threads, and an engine is one for the whole process.
    with _one_at_a_time:
        return _rendered(task, folder, noise, device, tell)


def _rendered(
    task: Task, folder: Path | None, noise: float | None, device: str, progress: Progress | None
) -> Outcome:
    found = fetch(task.recipe, task.base, folder, noise, device, progress)
    samples = int(found.view.metadata.get("samples", 0))
    return Outcome(
        task.recipe.name,
        found.place.key,
        found.seconds,
        samples,
        found.view.noise,
        platform.node(),
        found.seconds > 0,
    )
