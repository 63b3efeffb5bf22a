"""A worker ends with the process that started it, however that one ended."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Generator
from contextlib import contextmanager
from types import FrameType

GRACE_S = 20.0
"""For what is at work to save its sums."""

_at_work = False
_ending = False


def end_with_parent() -> None:
    """Watch the parent from now on. In a worker's main thread; where there is no parent, nothing happens.

    A killed parent sends nothing: its workers would wait for work for ever. The end of the pipe that it holds
    is seen on every system. What is `at_work` then is interrupted, as by Ctrl-C, and saves what it has. When
    it is done, or after `GRACE_S`, the worker ends, also where the interruption was lost on its way (Python
    drops one that arrives in a finaliser).
    """
    parent = multiprocessing.parent_process()
    if parent is None:
        return
    # not Ctrl-C's signal: in the background of a shell that one is ignored
    signal.signal(signal.SIGTERM, _interrupted)

    def watch() -> None:
        parent.join()
        os.kill(os.getpid(), signal.SIGTERM)
        limit = time.monotonic() + GRACE_S
        while _at_work and time.monotonic() < limit:
            time.sleep(0.05)
        os._exit(1)

    threading.Thread(target=watch, name="watch-parent", daemon=True).start()


@contextmanager
def at_work() -> Generator[None]:
    """What is done within is interrupted when the worker is to end, and then it ends."""
    global _at_work
    _at_work = True
    try:
        yield
    except SystemExit:  # between launches SIGTERM is taken as this
        os._exit(1)
    except KeyboardInterrupt:
        if _ending:
            os._exit(1)
        raise
    finally:
        _at_work = False


def _interrupted(number: int, frame: FrameType | None) -> None:
    global _ending
    _ending = True
    if _at_work:
        raise KeyboardInterrupt
    os._exit(1)
