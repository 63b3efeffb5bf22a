"""Many parts of a work: by processes on this machine, by workers of a Dask cluster, or a share of them.

One function does one part. Workers are spawned, and recycled after many parts. What a part finds is its
result, and what it keeps on disk stays: a worker that dies loses nothing that is complete.
"""

from __future__ import annotations

import logging
import multiprocessing
import os
import queue
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import Queue
from typing import Generic, TypeAlias, TypeVar

from ..core.progress import Progress
from ..core.words import duration
from ..errors import DiskFullError, EdofsimError, EngineError, InputError
from .engine import set_threads, thread_count
from .orphans import at_work, end_with_parent

T = TypeVar("T")
R = TypeVar("R")
Messages: TypeAlias = "Queue[tuple[int, float]]"

PARTS_A_WORKER = 64
"""Then a worker makes way for a new one, in case that a library keeps memory. Mitsuba does not: after two
members of `clutter` a worker held 1.3 GiB, after 24 of them 1.4."""


@dataclass(frozen=True)
class Spread:
    """How a work is spread.

    jobs: worker processes, which share the processors.
    cluster: address of a Dask scheduler whose workers see the same files, instead.
    shard: (i, n), only the i-th of n shares.
    """

    jobs: int = 1
    cluster: str | None = None
    shard: tuple[int, int] | None = None

    @property
    def alone(self) -> bool:
        """Whether no worker is asked for."""
        return self.jobs == 1 and self.cluster is None


def shard_of(parts: Sequence[T], shard: tuple[int, int] | None) -> list[T]:
    """Every n-th part, beginning with the i-th, for shard (i, n) with i from 1 to n.

    Raises InputError for a shard that does not exist."""
    if shard is None:
        return list(parts)
    number, count = shard
    if not 1 <= number <= count:
        raise InputError(
            f"there is no shard {number}/{count}: the first of {count} is 1/{count}, the last {count}/{count}"
        )
    return list(parts[number - 1 :: count])


class Workers(Generic[T, R]):
    """Parts at work, and what became of them.

    work: does a part; module level, so that a worker finds it.
    failed: what becomes of part `number` that ended with a message, or whose worker died.
    keep: gets each result as it comes.
    called: what parts are called where progress is reported.
    """

    def __init__(
        self,
        parts: Sequence[T],
        work: Callable[[T, Progress], R],
        failed: Callable[[int, EdofsimError], R],
        say: Progress,
        keep: Callable[[R], None] | None = None,
        called: str = "scenes",
    ) -> None:
        self.parts, self.work, self.failed, self.say = parts, work, failed, say
        self.keep, self.called = keep, called
        self.results: dict[int, R] = {}
        self.fractions: dict[int, float] = {}
        self.messages: Messages | None = None
        self.started = time.perf_counter()

    def run(self, jobs: int, cluster: str | None) -> list[R]:
        """All parts, whatever becomes of the workers; results in the order of the parts.

        A worker that dies takes its pool with it. The parts that were at work then are done one by one, so
        that only the one which is too much for a worker fails; the others go on in a new pool.
        """
        try:
            if cluster is not None:
                with _dask(cluster) as executor:
                    self._run(executor, range(len(self.parts)), len(self.parts))
            else:
                self._in_pools(jobs)
        finally:
            if self.messages is not None:
                self.messages.close()
        return [self.results[number] for number in range(len(self.parts))]

    def _in_pools(self, jobs: int) -> None:
        rest: Sequence[int] = range(len(self.parts))
        while rest:
            with self._pool(jobs) as executor:
                suspects = self._run(executor, rest, jobs)
            for number in suspects:
                with self._pool(1) as executor:
                    if self._run(executor, [number], 1):
                        self._keep(number, self.failed(number, EdofsimError(LOST)))
            rest = [number for number in rest if number not in self.results]

    def _run(self, executor: Executor, numbers: Sequence[int], at_once: int) -> list[int]:
        """Have parts done. Returns those that were at work when a worker died and took the pool with it.

        No more than `at_once` are handed over: a pool whose workers find a backlog when they make way for new
        ones stops for ever (CPython, issue 115634).
        """
        todo = deque(numbers)
        waiting: dict[Future[R], int] = {}
        suspects: list[int] = []
        try:
            while todo or waiting:
                try:
                    while todo and len(waiting) < at_once:
                        number = todo[0]
                        waiting[executor.submit(_work, number, self.work, self.parts[number])] = number
                        todo.popleft()
                except BrokenProcessPool:
                    todo.clear()
                done, _ = wait(waiting, timeout=0.5, return_when=FIRST_COMPLETED)
                for future in done:
                    number = waiting.pop(future)
                    try:
                        self._keep(number, self._result(number, future))
                    except BrokenProcessPool:
                        suspects.append(number)
                        todo.clear()
                self._tell()
        except BaseException:
            for future in waiting:
                future.cancel()
            raise
        return suspects

    def _result(self, number: int, future: Future[R]) -> R:
        try:
            return future.result()
        except (DiskFullError, EngineError, BrokenProcessPool):
            raise
        except EdofsimError as error:
            return self.failed(number, error)
        except CancelledError as error:
            raise EdofsimError(
                f"the Dask scheduler went away; finished {self.called} are kept: start it, and the same "
                "command, again"
            ) from error
        except Exception as error:
            if not isinstance(error, _killed_worker()):
                raise
            return self.failed(number, EdofsimError(LOST))

    def _keep(self, number: int, result: R) -> None:
        self.results[number] = result
        self.fractions[number] = 1.0
        if self.keep:
            self.keep(result)

    def _tell(self) -> None:
        while self.messages is not None:
            try:
                number, fraction = self.messages.get_nowait()
            except queue.Empty:
                break
            self.fractions[number] = max(fraction, self.fractions.get(number, 0.0))
        done = sum(self.fractions.values()) / max(1, len(self.parts))
        spent = time.perf_counter() - self.started
        left = f", {duration(spent * (1 - done) / done)} left" if done > 0.02 else ""
        self.say(done, f"{len(self.results)} of {len(self.parts)} {self.called}{left}")

    @contextmanager
    def _pool(self, jobs: int) -> Generator[Executor]:
        context = multiprocessing.get_context("spawn")
        self.messages = self.messages or context.Queue()
        threads = max(1, thread_count() // jobs)
        executor = ProcessPoolExecutor(
            jobs, context, _start_worker, (threads, self.messages), max_tasks_per_child=PARTS_A_WORKER
        )
        try:
            yield executor
        finally:
            # Workers get Ctrl-C too, and save their sums; wait for them.
            executor.shutdown(wait=True, cancel_futures=True)


LOST = "its worker died, most likely for want of memory; try it with fewer --jobs, or more memory a worker"


def _killed_worker() -> tuple[type[Exception], ...]:
    """What Dask raises for a part whose workers died again and again; nothing where Dask is not in use."""
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
    # what goes wrong is given in one message; Dask's own log of it is pages long
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
    os.environ["OMP_NUM_THREADS"] = str(threads)  # PyTorch takes as many, if a part needs it
    if "torch" in sys.modules:
        sys.modules["torch"].set_num_threads(threads)


def _work(number: int, work: Callable[[T, Progress], R], part: T) -> R:
    """Do one part: what every worker runs."""
    last = 0.0

    def tell(fraction: float, message: str) -> None:
        nonlocal last
        if _messages is not None and time.monotonic() - last > 0.5:
            last = time.monotonic()
            _messages.put((number, min(fraction, 0.99)))

    # A Dask worker has several threads, and an engine is one for the whole process.
    with _one_at_a_time, at_work():
        return work(part, tell)
