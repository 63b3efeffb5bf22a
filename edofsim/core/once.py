"""What is made once and used by several threads."""

from __future__ import annotations

import threading
from collections.abc import Callable, Hashable
from concurrent.futures import Future
from typing import Any, TypeVar, cast

Made = TypeVar("Made")


class Once:
    """Things by what they are made from. Whoever asks first makes one; who asks meanwhile waits for it."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._found: dict[Hashable, Future[Any]] = {}  # pyrefly: ignore[explicit-any]

    def get(self, key: Hashable, make: Callable[[], Made]) -> Made:
        """What was made for a key, else what `make` returns now. Its exception is raised for all who wait,
        and not remembered."""
        with self._lock:
            known = self._found.get(key)
            mine = Future() if known is None else known
            self._found[key] = mine
        if known is None:
            try:
                mine.set_result(make())
            except BaseException as error:
                with self._lock:
                    del self._found[key]
                mine.set_exception(error)
        return cast(Made, mine.result())
