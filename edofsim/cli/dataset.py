"""`edofsim dataset`."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from .. import console
from ..core.progress import part
from ..errors import EdofsimError, InputError
from ..options import Device, DeviceOption, JsonOption, Output, Spreading, grouped
from ..record import writable_folder
from .many import seen_by, share_of, spread_of, work_on
from .shared import Done, begun, figures_table, finish

dataset_app = typer.Typer(help="Data sets of photos with their sharp images, to train on.")


def make(
    recipe: Annotated[str, typer.Argument(metavar="RECIPE", help="Dataset recipe, a TOML file.")],
    forecast_only: Annotated[
        bool, typer.Option("--forecast", help="Only predict time, bytes and core hours.")
    ] = False,
    *,
    spread: Spreading,
    device: DeviceOption = Device.auto,
    to: Output,
) -> Done:
    """Make the data set of a recipe.

    The same command resumes interrupted work, to the same bytes. After several commands with --shard, the
    same command without it joins their shares.

    Figures: pairs, pairs.made, forecast.{core_seconds,bytes}, bytes, core_seconds.{render,photos} (of the
    processor).
    """
    how = spread_of(spread)
    with begun("dataset make", to.json, quiet=to.quiet) as progress:
        from ..data import make as making
        from ..data.parts import understood
        from ..data.taken import take_part
        from ..recipe.load import load_dataset

        loaded = load_dataset(recipe)
        work = understood(loaded)
        for each in work.parts:
            work.frames(each)  # before any time is spent
        path = to.out or Path("out") / loaded.recipe.name
        folder = making.begun(work, writable_folder(path))
        expected = making.forecast(work, folder, spread.jobs)
        if not to.quiet:
            console.err.print(str(expected), markup=False)
        if forecast_only:
            return finish("dataset make", [str(expected)], making.figures_of(expected, [], path), {}, to.json)
        making.check_room(expected, path)
        there = seen_by(how, path)
        folder = making.begun(work, there)
        numbers = share_of(range(len(work.parts)), how)
        names = [work.parts[number].name for number in numbers]
        take = partial(take_part, work=work, folder=folder, device=device.value)
        spent, problems, failures = work_on(numbers, names, take, how, part(progress, 0.0, 0.9))
        sums = making.finished(work, folder, part(progress, 0.9, 1.0))
        figures = making.figures_of(expected, [each for each in spent if each is not None], path)
        lines = (
            [] if sums else ["pairs of other shares are missing yet: this command without --shard ends it"]
        )
        outputs = {"data": path, **({"checksums": sums} if sums else {})}
        inputs = {"recipe": str(loaded.path)}
        done = finish(
            "dataset make", [*lines, figures_table(figures)], figures, outputs, to.json, inputs=inputs
        )
        if problems:
            raise InputError(problems)
        if failures:
            raise EdofsimError("\n".join(failures))
        return done


dataset_app.command()(grouped(make))


@dataset_app.command()
def verify(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of a data set.")],
    json: JsonOption = None,
) -> Done:
    """Check every file against its checksum.

    Damaged, missing and extra files are named (status 2).

    Figures: files.good, files.wrong.
    """
    with begun("dataset verify", json, quiet=True):
        from ..data.kept import problems_of

        good, problems = problems_of(folder)
        figures = {"files.good": good, "files.wrong": len(problems)}
        return finish(
            "dataset verify", [f"{good} files are as written"], figures, {}, json, problems=problems
        )
