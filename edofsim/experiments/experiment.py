"""What an experiment gets and gives."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Generic, ParamSpec

if TYPE_CHECKING:
    from ..report.page import Page, Table
P = ParamSpec("P")


@dataclass(frozen=True)
class Findings:
    """What an experiment found.

    figures: flat, a dotted name with its unit to a number; the command prints them, or `shown` in their
        place.
    page: is written to the folder as NAME.html.
    outputs: files that the experiment wrote, by what they are.
    problems: a sentence for each input that could not be used while the rest was finished; the command then
        ends with status 2.
    inputs: for the JSON, in addition to or in place of the options.
    record: more for it.
    """

    figures: Mapping[str, float]
    page: Page | None = None
    shown: Sequence[Table | str] = ()
    outputs: Mapping[str, Path] = field(default_factory=dict)
    problems: Sequence[str] = ()
    inputs: Mapping[str, object] = field(default_factory=dict)
    record: Mapping[str, object] = field(default_factory=dict)


@dataclass(frozen=True)
class Paper:
    """What a run of all experiments of the paper is given.

    photos, chart, cubes: None for what ships or is drawn.
    full: the paper's sizes instead of small ones.
    cache: of rendered views, None for the default.
    """

    photos: Path | None = None
    chart: Path | None = None
    cubes: Path | None = None
    full: bool = False
    seed: int = 0
    cache: Path | None = None

    @property
    def limit(self) -> int | None:
        """Photographs to use."""
        return None if self.full else 4

    @property
    def systems(self) -> list[str] | None:
        """All systems, or the networks that ship where time is short."""
        from ..restore.checkpoint import shipped_checkpoints

        return None if self.full else list(shipped_checkpoints())


@dataclass(frozen=True)
class Experiment(Generic[P]):
    """What is known of an experiment in addition to what it runs.

    in_paper: its own options in `edofsim evaluate paper`, None where it is no part of that.
    option: of `run`, names of parts of its work, which can be done in any order and place, each of which
        keeps what it found in the folder; None where it has no such parts.
    every: all names, where the option is not given.
    """

    run: Callable[P, Findings]
    in_paper: Callable[[Paper], Mapping[str, object]] | None = None
    option: str | None = None
    every: Callable[[Mapping[str, object]], Sequence[str]] = lambda options: ()

    def __call__(self, *given: P.args, **options: P.kwargs) -> Findings:
        return self.run(*given, **options)

    @classmethod
    def of(cls, run: Callable[P, Findings]) -> Experiment[P]:
        """What a registry or a decorator is given, which may be one already."""
        return run if isinstance(run, Experiment) else cls(run)


def in_parts(
    option: str, every: Callable[[Mapping[str, object]], Sequence[str]]
) -> Callable[[Callable[P, Findings]], Experiment[P]]:
    """Gives an experiment the options --jobs, --cluster and --shard.

    option, every: as of `Experiment`.
    """
    return lambda run: replace(Experiment.of(run), option=option, every=every)


def in_paper(
    options: Callable[[Paper], Mapping[str, object]],
) -> Callable[[Callable[P, Findings]], Experiment[P]]:
    """Makes an experiment part of `edofsim evaluate paper`, with these options of its own.

    options: its own there, by what `evaluate paper` was given.
    """
    return lambda run: replace(Experiment.of(run), in_paper=options)
