"""Independent pieces of work on the cores of a CPU, one thread each.

The pieces are many small tensor operations. PyTorch would split each of them over all cores and wait for the
slowest, every time; on a machine that others use too that costs more than it gains.
"""

from __future__ import annotations

import sys
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import TypeVar

import torch

Item = TypeVar("Item")
Result = TypeVar("Result")

MOST_THREADS = 32
"""Each holds working memory of its own; beyond this many the cores wait for memory anyway."""

SWITCH_S = 5e-5
"""After so long, in seconds, a thread that waits for Python gets it from another. Of the 5 ms that are usual,
pieces of many small operations wait often: each gives Python away, and wants it back a moment later."""

END = object()
"""What no iterator gives."""

_lock = threading.Lock()
_users = 0
_threads = 1
_switch_s = 5e-3


class _Of(threading.local):
    """Of this thread: whether it works on a piece."""

    a_piece = False


_of = _Of()


def in_threads(work: Callable[[Item], Result], items: Sequence[Item], device: torch.device) -> list[Result]:
    """work(item) for each item, without gradients, in the order of the items.

    On a CPU as many at a time as PyTorch may use threads, each operation on one of them; elsewhere, and for
    pieces of a piece, one after another. An exception of one item is raised here.
    """
    count = min(1 if _of.a_piece else threads_allowed(), len(items), MOST_THREADS)
    inference = torch.is_inference_mode_enabled()

    def alone(item: Item) -> Result:
        with torch.inference_mode(inference), torch.no_grad():
            return work(item)

    def piece(item: Item) -> Result:
        _of.a_piece = True
        return alone(item)

    if count <= 1 or device.type != "cpu":
        return [alone(item) for item in items]
    with one_thread_an_operation(), ThreadPoolExecutor(count) as pool:
        return list(pool.map(piece, items))


def in_turns(chains: Sequence[Iterator[object]], device: torch.device) -> None:
    """Take each of these iterators to its end, several at a time as `in_threads` does: threads take a step of
    one after another, so that no long one is left over for a thread alone."""
    waiting = deque(chains)

    def advance(_: int) -> None:
        while True:
            try:
                chain = waiting.popleft()
            except IndexError:  # those that are left have a thread each
                return
            if next(chain, END) is not END:
                waiting.append(chain)

    in_threads(advance, range(len(chains)), device)


def threads_allowed() -> int:
    """As many as PyTorch may use, also while each operation has but one of them."""
    with _lock:
        return _threads if _users else torch.get_num_threads()


@contextmanager
def one_thread() -> Generator[None]:
    """All work of this process on one thread, for timings in seconds of the processor."""
    with _threads_an_operation(1):
        yield


@contextmanager
def all_threads() -> Generator[None]:
    """Each operation on as many threads as PyTorch may use, also within `one_thread_an_operation`."""
    with _threads_an_operation(threads_allowed()):
        yield


@contextmanager
def _threads_an_operation(count: int) -> Generator[None]:
    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)


@contextmanager
def one_thread_an_operation() -> Generator[None]:
    """Work of many small operations, each on one thread; `in_threads` uses as many as before.

    PyTorch's number of threads and how long a thread waits for Python are the whole process's: the first user
    sets them, the last sets them back."""
    global _users, _threads, _switch_s
    with _lock:
        if _users == 0:
            _threads, _switch_s = torch.get_num_threads(), sys.getswitchinterval()
            torch.set_num_threads(1)
            sys.setswitchinterval(min(SWITCH_S, _switch_s))
        _users += 1
    try:
        yield
    finally:
        with _lock:
            _users -= 1
            if _users == 0:
                torch.set_num_threads(_threads)
                sys.setswitchinterval(_switch_s)
