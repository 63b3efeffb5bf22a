"""`python -m edofsim`, the same as `edofsim`; several GPUs: `torchrun -m edofsim train ...`."""

import gc
import os
from pathlib import Path

from .core.interrupts import interrupt_after_imports

FRESH = 50_000
"""Objects made and still there, after which the youngest are looked through for garbage."""
LARGE_PAGES = Path("/sys/kernel/mm/transparent_hugepage/enabled")


def main() -> None:
    """Entry point of the command.

    Libraries leave 300,000 objects that stay for good: to look through these for garbage as often as Python
    does takes two thirds of a second of a first run.
    """
    interrupt_after_imports()
    gc.set_threshold(FRESH, 20, 10)
    ask_for_large_pages()
    from .cli import main as command

    command()


def ask_for_large_pages() -> None:
    """Let PyTorch, which is still to be imported, hold large tensors in pages of 2 MiB where the system has
    them: two threads that ask for memory in pages of 4 KiB wait for each other. What the user set stays."""
    if LARGE_PAGES.exists():
        os.environ.setdefault("THP_MEM_ALLOC_ENABLE", "1")


if __name__ == "__main__":
    main()
