"""What a command shows while it works, and how it ends."""

from __future__ import annotations

import errno
import logging
import re
import sys
import time
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.progress import Progress as Bar

from .core.progress import Progress, silent
from .errors import EdofsimError, InputError

FILE_WIDTH = 160  # columns of a table that goes to a file or a pipe

out = Console(highlight=False, soft_wrap=True, width=None if sys.stdout.isatty() else FILE_WIDTH)
err = Console(stderr=True, highlight=False, soft_wrap=True)

LINE_EVERY_S = 10.0

MOST_PROBLEMS = 30  # a wrong word in each of thousands of objects is one mistake

DONE, FAILED, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130


@contextmanager
def progress(title: str, *, quiet: bool = False) -> Generator[Progress]:
    """Shows how far work is: a bar on a terminal, a line now and then elsewhere."""
    if quiet:
        yield silent
    elif err.is_terminal:
        columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.percentage:>3.0f}%"))
        with Bar(*columns, TimeElapsedColumn(), TimeRemainingColumn(), console=err, transient=True) as bar:
            task = bar.add_task(title, total=1.0)
            yield lambda done, text: bar.update(task, completed=done, description=f"{title}: {text}")
    else:
        yield _line_printer(title)


def _line_printer(title: str) -> Progress:
    last = {"time": -LINE_EVERY_S, "stage": ""}

    def show(done: float, text: str) -> None:
        stage, now = text.split(":")[0].split(",")[0], time.monotonic()
        if stage != last["stage"] or now - last["time"] >= LINE_EVERY_S:
            last.update(time=now, stage=stage)
            print(f"{title}: {done:4.0%} {text}", file=sys.stderr, flush=True)

    return show


def show_outputs(outputs: Mapping[str, str | Path]) -> None:
    """The last lines of a command: where its files are."""
    for name, path in outputs.items():
        out.print(f"{name}: {Path(path)}", markup=False)


def exit_status(command: Callable[[], object]) -> int:
    """Run a command, with the warnings of the package on the error channel.

    What goes wrong ends in one message and in the status that says whose fault it was."""
    log = logging.getLogger("edofsim")
    if not any(isinstance(handler, _Warnings) for handler in log.handlers):
        log.addHandler(_Warnings())
    try:
        command()
    except InputError as error:
        return _complain(error.problems, BAD_INPUT)
    except EdofsimError as error:
        return _complain([str(error)], FAILED)
    except KeyboardInterrupt:
        return _complain(["interrupted; repeat the command to resume from what is finished"], INTERRUPTED)
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            return _complain(
                [f"{error.filename or 'the disk'}: no space left; free some and run the same again"], FAILED
            )
        place = error.filename or "a file"
        return _complain(
            [f"{place}: {error.strerror or error}; see to it, or name another place, and run the same again"],
            FAILED,
        )
    except (MemoryError, RuntimeError) as error:
        size = refused_memory(error)
        if size is None:
            raise
        return _complain(
            [
                f"out of memory: {size} more could not be had; what bounds it is the size of the work: "
                "the scene's [frame] width_px, height_px and margin_px, [bands] count and [render] "
                "fragments, the camera's [psf] window_px, --layers and --bands"
            ],
            FAILED,
        )
    return DONE


def refused_memory(error: Exception) -> str | None:
    """How much memory an error says could not be had, in words; None where it is of another kind.

    NumPy raises MemoryErrors, PyTorch and Dr.Jit RuntimeErrors that only their texts tell from others."""
    text = str(error)
    asked = "out of memory" in text.lower() or "allocate memory" in text.lower()
    if not (isinstance(error, MemoryError) or asked):
        return None
    found = re.search(r"allocate\s+([\d.]+)\s*([KMGTPE]iB|bytes)", text)
    if found is None:
        return "an unknown amount"
    if found[2] != "bytes":
        return f"{found[1]} {found[2]}"
    return f"{float(found[1]) / 2**30:.3g} GiB"


class _Warnings(logging.Handler):
    """What a user must know although the work goes on."""

    def emit(self, record: logging.LogRecord) -> None:
        print(f"edofsim: {record.getMessage()}", file=sys.stderr, flush=True)


def _complain(problems: Sequence[str], status: int) -> int:
    rest = len(problems) - MOST_PROBLEMS
    shown = [*problems[:MOST_PROBLEMS], f"and {rest} more like these"] if rest > 0 else problems
    for problem in shown:
        err.print(f"edofsim: {problem}", markup=False, style="red" if err.is_terminal else None)
    return status
