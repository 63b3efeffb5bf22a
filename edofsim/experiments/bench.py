"""Speed and memory, by the benchmarks of the source checkout."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ..core.progress import Progress
from ..errors import InputError
from ..record import commit_of, machine
from ..report import Column, Table
from .experiment import Findings


def run(
    folder: Path,
    progress: Progress,
    names: Annotated[
        list[str] | None,
        typer.Argument(metavar="[NAME...]", help="optics, render, expose, learn; default all."),
    ] = None,
    full: Annotated[bool, typer.Option("--full", help="Larger frames and more cases: half an hour.")] = False,
) -> Findings:
    """Measure speed and memory.

    Figures are ratios within one run, with medians. The machine should be idle. It needs a source checkout.
    `expose` keeps each piece that it has finished in --out, for this code and machine; delete them there to
    measure anew.
    """
    try:
        from benchmarks import run as benches
    except ModuleNotFoundError as error:
        if error.name not in ("benchmarks", "benchmarks.run"):
            raise
        raise InputError(
            "benchmarks come with the source checkout, not with the installed package: run this there"
        ) from None
    figures = benches.run(names or tuple(benches.BENCHES), progress, folder, full)
    table = Table(
        (Column("figure"), Column("value")), tuple((name, f"{value:.4g}") for name, value in figures.items())
    )
    about = machine()
    line = f"{about['processor']}, {about['cores']} cores, {about['memory_gib']} GiB, {about['system']}"
    commit = commit_of(Path(benches.__file__).parent)
    return Findings(figures, shown=[table, f"{line}; commit {commit}"])
