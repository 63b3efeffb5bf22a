"""`python -m edofsim`, the same as `edofsim`; several GPUs: `torchrun -m edofsim train ...`."""

import gc

from .core.interrupts import interrupt_after_imports


def main() -> None:
    """Entry point of the command.

    Libraries leave 300,000 objects that stay for good: to look through these for garbage again and again
    takes a tenth of the start, and most of a tenth of a second each time later.
    """
    interrupt_after_imports()
    gc.disable()
    from .cli import main as command

    gc.freeze()
    gc.enable()
    command()


if __name__ == "__main__":
    main()
