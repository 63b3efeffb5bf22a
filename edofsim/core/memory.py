"""Memory that is free, and held nevertheless."""

from __future__ import annotations

import ctypes
import sys
from contextlib import suppress


def give_back_renderers_memory() -> None:
    """`give_back_memory` where anything was rendered in this process; else what is kept is soon taken again,
    without waiting for the system."""
    if "drjit" in sys.modules:
        give_back_memory()


def give_back_memory() -> None:
    """Give freed memory back to the system, the renderer's too, and where the C library can be asked to: else
    threads keep theirs."""
    if "drjit" in sys.modules:
        sys.modules["drjit"].flush_malloc_cache()
    with suppress(OSError, AttributeError, TypeError):
        ctypes.CDLL(None).malloc_trim(0)
