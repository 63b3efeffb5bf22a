"""The workers of a batch, on this machine or on a Dask cluster, and what becomes of their views."""

from __future__ import annotations

import json
import logging
import math
import multiprocessing
import platform
import queue
import sys
import threading
import time
from collections import deque
from collections.abc import Generator, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from multiprocessing import Queue
from pathlib import Path
from typing import TypeAlias

from ..core.files import append_line
from ..core.progress import Progress
from ..errors import DiskFullError, EdofsimError, EngineError, InputError
from ..recipe.scene import SceneRecipe
from .engine import set_threads, thread_count
from .fetch import fetch, is_picture, place_of
from .orphans import at_work, end_with_parent

Messages: TypeAlias = "Queue[tuple[int, float]]"

VIEWS_A_WORKER = 8
"""Then a worker makes way for a new one: Mitsuba's memory grows with every scene."""


@dataclass(frozen=True)
class Task:
    """A recipe and the folder that files named in it start from."""

    recipe: SceneRecipe
    base: Path


@dataclass(frozen=True)
class RenderOutcome:
    """What became of a task. seconds: of rendering, 0 if it was in the cache; error: empty if all went
    well; origin: of a view that is not fresh, `cache`, or `file` where it is read from the scene's own."""

    name: str
    key: str
    seconds: float
    samples: int
    noise: float
    host: str
    fresh: bool
    error: str = ""
    origin: str = "cache"


def duration(seconds: float) -> str:
    """A time in words."""
    if seconds < 120:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 7200 else f"{seconds / 3600:.1f} h"


def note(manifest: Path, outcome: RenderOutcome) -> None:
    """A line of the manifest. One on a view that was there already may be missing: its folder may be such
    that it can only be read."""
    line = json.dumps({"time": time.time(), **asdict(outcome)}, sort_keys=True)
    try:
        append_line(manifest, line)
    except EdofsimError:
        if outcome.fresh:
            raise


class Batch:
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
        self.outcomes: dict[int, RenderOutcome] = {}
        self.parts: dict[int, float] = {}
        self.messages: Messages | None = None
        self.started = time.perf_counter()

    def render(self, jobs: int, cluster: str | None) -> None:
        """All tasks, whatever becomes of the workers.

        A worker that dies takes its pool with it. The views that were at work then are rendered one by one,
        so that only the one which is too much for a worker fails; the others go on in a new pool.
        """
        if cluster is not None:
            with _dask(cluster) as executor:
                self._run(executor, range(len(self.tasks)), len(self.tasks))
            return
        rest: Sequence[int] = range(len(self.tasks))
        while rest:
            with self._pool(jobs) as executor:
                suspects = self._run(executor, rest, jobs)
            for number in suspects:
                with self._pool(1) as executor:
                    if self._run(executor, [number], 1):
                        self._keep(number, self._failed(number, LOST))
            rest = [number for number in rest if number not in self.outcomes]

    def _run(self, executor: Executor, numbers: Sequence[int], at_once: int) -> list[int]:
        """Have tasks rendered. Returns those that were at work when a worker died and took the pool with it.

        No more than `at_once` are handed over: a pool whose workers find a backlog when they make way for new
        ones stops for ever (CPython, issue 115634).
        """
        todo = deque(numbers)
        waiting: dict[Future[RenderOutcome], int] = {}
        suspects: list[int] = []
        try:
            while todo or waiting:
                try:
                    while todo and len(waiting) < at_once:
                        number, task = todo[0], self.tasks[todo[0]]
                        arguments = (number, task, self.folder, self.noise, self.device)
                        waiting[executor.submit(_work, *arguments)] = number
                        todo.popleft()
                except BrokenProcessPool:
                    todo.clear()
                done, _ = wait(waiting, timeout=0.5, return_when=FIRST_COMPLETED)
                for future in done:
                    number = waiting.pop(future)
                    try:
                        self._keep(number, self._outcome(number, future))
                    except BrokenProcessPool:
                        suspects.append(number)
                        todo.clear()
                self._tell()
        except BaseException:
            for future in waiting:
                future.cancel()
            raise
        return suspects

    def _outcome(self, number: int, future: Future[RenderOutcome]) -> RenderOutcome:
        try:
            return future.result()
        except (DiskFullError, EngineError, BrokenProcessPool):
            raise
        except EdofsimError as error:
            return self._failed(number, str(error))
        except CancelledError as error:
            raise EdofsimError(
                "the Dask scheduler went away; finished views are kept: start it, and the same command, again"
            ) from error
        except Exception as error:
            if not isinstance(error, _killed_worker()):
                raise
            return self._failed(number, LOST)

    def _keep(self, number: int, outcome: RenderOutcome) -> None:
        self.outcomes[number] = outcome
        self.parts[number] = 1.0
        note(self.manifest, outcome)

    def _failed(self, number: int, error: str) -> RenderOutcome:
        task = self.tasks[number]
        key = place_of(task.recipe, task.base, self.folder, self.noise).key
        return RenderOutcome(task.recipe.name, key, 0.0, 0, math.nan, platform.node(), False, error)

    def _tell(self) -> None:
        while self.messages is not None:
            try:
                number, part = self.messages.get_nowait()
            except queue.Empty:
                break
            self.parts[number] = max(part, self.parts.get(number, 0.0))
        fraction = sum(self.parts.values()) / max(1, len(self.tasks))
        spent = time.perf_counter() - self.started
        left = f", {duration(spent * (1 - fraction) / fraction)} left" if fraction > 0.02 else ""
        self.say(fraction, f"{len(self.outcomes)} of {len(self.tasks)} views{left}")

    def close(self) -> None:
        """Let go of the queue."""
        if self.messages is not None:
            self.messages.close()

    @contextmanager
    def _pool(self, jobs: int) -> Generator[Executor]:
        context = multiprocessing.get_context("spawn")
        self.messages = self.messages or context.Queue()
        threads = max(1, thread_count() // jobs)
        executor = ProcessPoolExecutor(
            jobs, context, _start_worker, (threads, self.messages), max_tasks_per_child=VIEWS_A_WORKER
        )
        try:
            yield executor
        finally:
            # Workers get Ctrl-C too, and save their sums; wait for them.
            executor.shutdown(wait=True, cancel_futures=True)


LOST = "its worker died, most likely for want of memory; render it with fewer --jobs, or more memory a worker"


def _killed_worker() -> tuple[type[Exception], ...]:
    """What Dask raises for a task whose workers died again and again; nothing where Dask is not in use."""
    scheduler = sys.modules.get("distributed.scheduler")
    return (scheduler.KilledWorker,) if scheduler else ()


@contextmanager
def _dask(address: str) -> Generator[Executor]:
    try:
        from distributed import Client
    except ImportError as error:
        raise InputError("--cluster needs Dask: pip install 'edofsim[cluster]'") from error
    try:
        client = Client(address, timeout="20s")
    except (OSError, ValueError) as error:
        raise InputError(f"no Dask scheduler answers at {address}: {error}") from error
    # what goes wrong is told in one message; Dask's own log of it is pages long
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    with client:
        yield client.get_executor(pure=False)


_messages: Messages | None = None
_one_at_a_time = threading.Lock()


def _start_worker(threads: int, messages: Messages) -> None:
    global _messages
    _messages = messages
    end_with_parent()
    set_threads(threads)


def _work(number: int, task: Task, folder: Path, noise: float | None, device: str) -> RenderOutcome:
    """Render one task: what every worker runs."""
    last = 0.0

    def tell(fraction: float, message: str) -> None:
        nonlocal last
        if _messages is not None and time.monotonic() - last > 0.5:
            last = time.monotonic()
            _messages.put((number, min(fraction, 0.99)))

    # A Dask worker has several threads, and an engine is one for the whole process.
    with _one_at_a_time, at_work():
        return rendered(task, folder, noise, device, tell)


def rendered(
    task: Task, folder: Path | None, noise: float | None, device: str, progress: Progress | None
) -> RenderOutcome:
    """One task in this process."""
    found = fetch(task.recipe, task.base, folder, noise, device, progress)
    samples = int(found.view.metadata.get("samples", 0))
    return RenderOutcome(
        task.recipe.name,
        found.place.key,
        found.seconds,
        samples,
        found.view.noise,
        platform.node(),
        found.seconds > 0,
        origin="file" if is_picture(task.recipe) else "cache",
    )
