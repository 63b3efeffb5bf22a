"""The `edofsim` command. Each command is one function: its options, its help, and what it does."""

from __future__ import annotations

import atexit
import logging
import os
import sys
from contextlib import suppress
from typing import Annotated, NoReturn

import typer

from .. import __version__, console
from ..errors import InputError
from ..options import grouped
from .benchmark import benchmark_app
from .cache import cache_app
from .cost import cost
from .dataset import dataset_app
from .evaluate import evaluate_app
from .expose import expose
from .fabricate import fabricate
from .lens import lens_app
from .lists import list_
from .look import look
from .new import new
from .plan import plan
from .psf import psf
from .render import render
from .restore import restore
from .run import run
from .shared import Done
from .tools import doctor, schema
from .train import train


def show(done: Done | None, **_: object) -> None:
    """Print what a command came to."""
    if done is not None:
        done.show()


app = typer.Typer(
    help="A physically based 3D scene simulator for extended-depth-of-field cameras.",
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    result_callback=show,
)
for command in (run, look, render, expose, plan, cost, restore, train, psf, fabricate):
    app.command()(grouped(command))
app.add_typer(evaluate_app, name="evaluate")
app.add_typer(benchmark_app, name="benchmark")
app.add_typer(dataset_app, name="dataset")
app.add_typer(cache_app, name="cache")
app.add_typer(lens_app, name="lens")
app.command("list")(list_)
for command in (new, doctor, schema):
    app.command()(grouped(command))


@app.callback(invoke_without_command=True)
def root(
    context: typer.Context,
    version: Annotated[bool, typer.Option("--version", help="Print the version and stop.")] = False,
) -> None:
    if version:
        typer.echo(f"edofsim {__version__}")
    elif context.invoked_subcommand is None:
        typer.echo(context.get_help())


def main() -> None:
    """Entry point: every failure is one message and a status.

    0: done, 1: failed, 2: bad input, 130: interrupted.
    """
    status: int | None = None
    # what is registered first is done last: threads have ended by then, and libraries have tidied up
    atexit.register(lambda: None if status is None else _leave(status))
    status = console.exit_status(invoke)
    if status == console.INTERRUPTED:
        _leave(status)
    sys.exit(status)


def _leave(status: int) -> NoReturn:
    """End the process at once. To take apart what the libraries hold takes Python most of a second, and now
    and then its own end answered an interrupt with the signal, in place of this status."""
    logging.shutdown()
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):  # whoever read it has gone
            stream.flush()
    os._exit(status)


def invoke(arguments: list[str] | None = None) -> None:
    """Run the command line, by default the process's own.

    Raises InputError for a wrong one, and KeyboardInterrupt where it was interrupted.
    """
    try:
        ended = app(arguments, standalone_mode=False)
    except typer.Abort:
        raise KeyboardInterrupt from None
    except Exception as error:
        usage = getattr(error, "format_message", None)  # click's own exceptions: a wrong option or argument
        if usage is None:
            raise
        context = getattr(error, "ctx", None)
        names: list[str] = []
        while context is not None and context.parent is not None:
            names.insert(0, context.info_name)
            context = context.parent
        command = " ".join(["edofsim", *names])
        raise InputError(f"{usage().rstrip('.')}; see `{command} --help`") from None
    if ended == console.INTERRUPTED:  # Typer takes an interrupt for a way to end, with this status
        raise KeyboardInterrupt
