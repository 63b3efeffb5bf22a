"""`edofsim evaluate`: a command for each experiment that is registered, the index, and all of the paper's."""

from __future__ import annotations

import inspect
import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

from ..core.progress import Progress, part
from ..errors import EdofsimError, InputError
from ..experiments import EXPERIMENTS
from ..experiments.experiment import Experiment as Found
from ..experiments.experiment import Paper
from ..options import CacheOption, OutOption, Output, QuietOption, SeedOption, Spreading, grouped
from ..record import writable_folder
from .many import seen_by, share_of, spread_of, work_on
from .shared import Done, begun, figures_table, finish

if TYPE_CHECKING:
    from ..render.spread import Spread

LOG = logging.getLogger(__name__)


class Experiment(TyperCommand):
    """The command of an experiment, which is imported when it is run or its options are asked for."""

    def get_short_help_str(self, limit: int = 45) -> str:
        self.help = EXPERIMENTS.about(self.name or "")
        return super().get_short_help_str(limit)

    # what is handed on is Click's, which some versions of Typer hold inside
    def make_context(self, *given: Any, **more: Any) -> Any:  # pyrefly: ignore[explicit-any]
        alone = typer.Typer(add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None)
        alone.command(self.name)(command_of(self.name or ""))
        return typer.main.get_command(alone).make_context(*given, **more)


class Experiments(TyperGroup):
    def __init__(self, **attributes: Any) -> None:  # pyrefly: ignore[explicit-any]
        super().__init__(**attributes)
        self.commands = {**{name: Experiment(name) for name in EXPERIMENTS}, **self.commands}


evaluate_app = typer.Typer(
    cls=Experiments,
    help="Experiments of the paper and of edofsim. Each writes a page or pictures, a CSV and a JSON.",
    no_args_is_help=True,
)


def command_of(name: str) -> Callable[..., Done]:
    """An experiment's `run` as a command: its own options, and those that all experiments have, or all whose
    work is in parts."""

    found = Found.of(EXPERIMENTS[name])

    def command(to: Output, spread: Spreading | None = None, **options: object) -> Done:
        how = None if spread is None else spread_of(spread)
        with begun(name, to.json, quiet=to.quiet) as progress:
            return perform(name, options, to.out, to.json, progress, how)

    own = list(inspect.signature(found.run, eval_str=True).parameters.values())[2:]
    groups = {"spread": Spreading, "to": Output} if found.option else {"to": Output}
    kind = inspect.Parameter.KEYWORD_ONLY
    shared = [inspect.Parameter(each, kind, annotation=group) for each, group in groups.items()]
    every = [each.replace(kind=kind) for each in (*own, *shared)]
    command.__signature__ = inspect.Signature(every)  # type: ignore[attr-defined]
    command.__doc__ = found.run.__doc__
    return grouped(command)


def perform(
    name: str,
    options: Mapping[str, object],
    out: Path | None,
    json: Path | None,
    progress: Progress,
    how: Spread | None = None,
) -> Done:
    """Run an experiment, and write its page and JSON. json: None for OUT/NAME.json; how: the work of its
    parts is spread, None for one whose work is in none."""
    title = f"{name}-quick" if options.get("quick") else name
    folder = writable_folder(out or Path("out") / title)
    lost: list[str] = []
    if how is not None and not (how.alone and how.shard is None):
        options, lost = _spread(name, options, folder, how, part(progress, 0.0, 0.95))
        progress = part(progress, 0.95, 1.0)
    found = EXPERIMENTS[name](folder, progress, **options)
    outputs = dict(found.outputs)
    if found.page is not None:
        from ..report import write_page

        outputs["page"] = write_page(folder / f"{name}.html", found.page)
    seed = options.get("seed")
    given = {option: value for option, value in options.items() if option not in ("seed", "cache", "device")}
    done = finish(
        f"evaluate {name}",
        found.shown or [figures_table(found.figures)],
        found.figures,
        outputs,
        json or folder / f"{name}.json",
        problems=found.problems,
        seed=seed if isinstance(seed, int) else None,
        inputs={**given, **found.inputs},
        left_out=[*found.problems, *lost],
        rest=found.record,
    )
    return replace(done, failures=lost)


def _spread(
    name: str, options: Mapping[str, object], folder: Path, how: Spread, progress: Progress
) -> tuple[Mapping[str, object], list[str]]:
    """Have the parts of an experiment done by workers, or choose those of a share: its options for the parts
    that are kept in the folder then, and what was said of the others."""
    experiment = Found.of(EXPERIMENTS[name])
    assert experiment.option is not None
    given = options.get(experiment.option)
    typed = [str(each) for each in given] if isinstance(given, list) and given else experiment.every(options)
    names = share_of(typed, how)
    chosen = {**options, experiment.option: names}
    if how.alone:
        return chosen, []
    if how.cluster:
        from ..render.cache import default_folder

        names = [str(_absolute(each)) for each in names]
        chosen = {key: _absolute(value) for key, value in options.items()}
        if "cache" in chosen:
            chosen["cache"] = chosen["cache"] or default_folder().absolute()
    work = partial(_part_of, experiment=name, options=chosen, folder=seen_by(how, folder))
    ended, problems, failures = work_on(names, names, work, how, progress)
    done = [each for each, end in zip(names, ended, strict=True) if end is not None]
    return {**options, experiment.option: done}, [*problems, *failures]


def _part_of(
    part: str, progress: Progress, *, experiment: str, options: Mapping[str, object], folder: Path
) -> bool:
    """One part of an experiment, done by a worker: what it found is kept in the folder."""
    run = Found.of(EXPERIMENTS[experiment])
    run(folder, progress, **{**options, str(run.option): [part]})
    return True


def _absolute(value: object) -> object:
    """Paths and files that an option names, also within a system such as `camera.toml+own.py:function`, as a
    worker in another folder finds them."""
    if isinstance(value, list):
        return [_absolute(each) for each in value]
    if isinstance(value, Path):
        return value.absolute()
    if not isinstance(value, str):
        return value
    if Path(value).is_file():
        return str(Path(value).absolute())
    camera, plus, by = value.rpartition("+")
    place, colon, name = by.rpartition(":")
    by = f"{Path(place).absolute()}:{name}" if Path(place).is_file() else by
    by = str(Path(by).absolute()) if Path(by).is_file() else by
    return (str(_absolute(camera)) if camera else "") + plus + by


@evaluate_app.command()
def index(
    folder: Annotated[
        Path | None,
        typer.Argument(metavar="[DIR]", help="Folder of experiments; default out."),
    ] = None,
) -> Done:
    """Write an index page of experiments."""
    from ..report.experiments_index import write_index

    return Done(outputs={"index": write_index(folder or Path("out"))})


@evaluate_app.command()
def paper(
    photos: Annotated[
        Path | None,
        typer.Option(
            "--photos", metavar="DIR", help="Folder of photographs; default: those of scikit-image."
        ),
    ] = None,
    chart: Annotated[
        Path | None, typer.Option("--chart", metavar="FILE", help="Picture of a test chart; default: drawn.")
    ] = None,
    cubes: Annotated[
        Path | None, typer.Option("--cubes", metavar="PATH", help="Spectral cube, or a folder of them.")
    ] = None,
    full: Annotated[
        bool, typer.Option("--full", help="The paper's sizes: all photographs, all systems.")
    ] = False,
    only: Annotated[
        list[str] | None, typer.Option("--only", metavar="NAME", help="Only this experiment; repeatable.")
    ] = None,
    seed: SeedOption = 0,
    out: OutOption = None,
    cache: CacheOption = None,
    quiet: QuietOption = False,
) -> Done:
    """Run the paper's experiments at a small size.

    It also writes an index of their pages. Each has a folder in --out (default out/paper) with its page, CSV
    and JSON. One that fails is named, and the others run. The same command resumes interrupted work.
    """
    setting = Paper(photos, chart, cubes, full, seed, cache)
    folder = writable_folder(out or Path("out") / "paper")
    with begun("paper", None, quiet=quiet) as progress:
        return _all_of(setting, only or (), folder, progress)


def _all_of(setting: Paper, only: Sequence[str], folder: Path, progress: Progress) -> Done:
    from ..report.experiments_index import write_index

    options = {name: Found.of(EXPERIMENTS[name]).in_paper for name in EXPERIMENTS}
    every = {name: own(setting) for name, own in options.items() if own is not None}
    wrong = [name for name in only if name not in every]
    if wrong:
        raise InputError(f"no experiment {wrong[0]!r}; there are {', '.join(every)}")
    chosen = {name: own for name, own in every.items() if not only or name in only}
    outputs: dict[str, Path] = {}
    problems: list[str] = []
    failed: list[str] = []
    for number, (name, own) in enumerate(chosen.items()):
        say = part(progress, number / len(chosen), (number + 1) / len(chosen), name)
        say(0.0, "begins")
        try:
            done = perform(name, own, folder / name, None, say)
        except EdofsimError as error:
            LOG.warning("%s: %s (the others go on)", name, error)
            failed.append(name)
            continue
        page = next((path for path in done.outputs.values() if path.suffix == ".html"), None)
        if page is not None:
            outputs[name] = page
        problems += done.problems
        outputs["index"] = write_index(folder)
    if failed:
        raise EdofsimError(f"{', '.join(failed)}: failed, see above; the others are in {folder}")
    return Done(outputs=outputs, problems=problems)
