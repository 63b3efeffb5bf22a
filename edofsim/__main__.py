"""`python -m edofsim`, the same as `edofsim`; several GPUs: `torchrun -m edofsim train ...`."""

import gc

from .core.interrupts import interrupt_after_imports

FRESH = 50_000
"""Objects made and still there, after which the youngest are looked through for garbage."""


def main() -> None:
    """Entry point of the command.

    Libraries leave 300,000 objects that stay for good: to look through these for garbage as often as Python
    does takes two thirds of a second of a first run.
    """
    interrupt_after_imports()
    gc.set_threshold(FRESH, 20, 10)
    from .cli import main as command

    command()


if __name__ == "__main__":
    main()
