"""Commands over many scenes: each is one part of the work, done here or by workers."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from rich.table import Table

from ..core.progress import Progress, part
from ..errors import DiskFullError, EdofsimError, EngineError, InputError
from ..options import Spreading

if TYPE_CHECKING:
    from ..recipe import Loaded, SceneRecipe
    from ..render.spread import Spread
    from ..report import Table as PageTable

T = TypeVar("T")
R = TypeVar("R")
P = TypeVar("P", Path, Path | None)


@dataclass(frozen=True)
class OfScene:
    """What a command came to for one scene: what it prints, its figures, the files that it wrote; record:
    what else its JSON says."""

    scene: str
    printed: Sequence[str | Table | PageTable]
    figures: Mapping[str, float]
    outputs: Mapping[str, Path]
    record: Mapping[str, object] = field(default_factory=dict)


@dataclass(frozen=True)
class OfEach:
    """What a command came to for many scenes, in their order, under the names that one scene has if it is the
    only one, else with the scene's name behind. problems, failures: as those of `Done`."""

    done: Sequence[OfScene]
    single: bool
    problems: Sequence[str] = ()
    failures: Sequence[str] = ()
    figures: dict[str, float] = field(init=False, default_factory=dict)
    outputs: dict[str, Path] = field(init=False, default_factory=dict)

    def __post_init__(self) -> None:
        for each in self.done:
            dotted, said = ("", "") if self.single else (f".{each.scene}", f"{each.scene}: ")
            self.figures.update({f"{name}{dotted}": value for name, value in each.figures.items()})
            self.outputs.update({f"{said}{name}": path for name, path in each.outputs.items()})

    @property
    def record(self) -> dict[str, object]:
        """What else the JSON says: of one scene by its keys, of several by the keys' plural and the scene."""
        if self.single:
            return {key: value for each in self.done for key, value in each.record.items()}
        plural = {"fidelity": "fidelities", "plan": "plans"}
        keys = dict.fromkeys(key for each in self.done for key in each.record)
        return {
            plural.get(key, key): {each.scene: each.record.get(key) for each in self.done} for key in keys
        }

    @property
    def printed(self) -> list[str | Table | PageTable]:
        lines: list[str | Table | PageTable] = []
        for each in self.done:
            lines += each.printed if self.single else (each.scene, *each.printed)
        return lines


@dataclass(frozen=True)
class _Lost:
    """A part that came to nothing."""

    problems: tuple[str, ...]
    wrong_input: bool


def spread_of(given: Spreading) -> Spread:
    """The options --jobs, --cluster and --shard. Raises InputError for a share that is none."""
    from ..render.spread import Spread, shard_of

    jobs, cluster, shard = given.jobs, given.cluster, given.shard
    if shard is None:
        return Spread(jobs, cluster)
    number, slash, count = shard.partition("/")
    if not (slash and number.isdigit() and count.isdigit()):
        raise InputError(f"--shard {shard}: give I/N, such as 1/4 for the first of four")
    share = (int(number), int(count))
    shard_of((), share)
    return Spread(jobs, cluster, share)


def seen_by(how: Spread, path: P) -> P:
    """A path as the workers of a cluster find it, which are in folders of their own."""
    return path.absolute() if path is not None and how.cluster else path  # type: ignore[return-value]


def share_of(parts: Sequence[T], how: Spread) -> list[T]:
    """The parts of this share. Raises InputError where there are none."""
    from ..render.spread import shard_of

    chosen = shard_of(parts, how.shard)
    if not chosen and how.shard:
        number, count = how.shard
        raise InputError(f"--shard {number}/{count}: there are only {len(parts)} parts to share")
    return chosen


def work_on(
    parts: Sequence[T],
    names: Sequence[str],
    work: Callable[[T, Progress], R],
    how: Spread,
    progress: Progress,
) -> tuple[list[R | None], list[str], list[str]]:
    """What `work` makes of each part, None where it ended with a message; and these messages, those on wrong
    input apart from others. Here, one after the other, or by workers. Raises what ends all parts alike."""
    from ..render.spread import Workers

    def failed(number: int, error: EdofsimError) -> _Lost:
        said = error.problems if isinstance(error, InputError) else (str(error),)
        prefixed = tuple(line if names[number] in line else f"{names[number]}: {line}" for line in said)
        return _Lost(prefixed, isinstance(error, InputError))

    ended: list[R | _Lost] = []
    if how.alone:
        for number, each in enumerate(parts):
            several = names[number] if len(parts) > 1 else ""
            say = part(progress, number / len(parts), (number + 1) / len(parts), several)
            try:
                ended.append(work(each, say))
            except (DiskFullError, EngineError):
                raise
            except EdofsimError as error:
                ended.append(failed(number, error))
    else:
        ended = Workers[T, R | _Lost](parts, work, failed, progress).run(how.jobs, how.cluster)
    lost = [each for each in ended if isinstance(each, _Lost)]
    problems = [line for each in lost if each.wrong_input for line in each.problems]
    failures = [line for each in lost if not each.wrong_input for line in each.problems]
    if len(lost) == len(parts):
        raise EdofsimError("\n".join([*problems, *failures])) if failures else InputError(problems)
    return [None if isinstance(each, _Lost) else each for each in ended], problems, failures


def of_each(
    parts: Sequence[T],
    names: Sequence[str],
    work: Callable[[T, Progress], OfScene],
    how: Spread,
    progress: Progress,
) -> OfEach:
    """What a command comes to for each scene; see `work_on`."""
    twins = sorted({name for name in names if names.count(name) > 1})
    if twins:
        raise InputError(f"{', '.join(twins)}: two of the scenes have this name; rename one of them")
    single = len(parts) == 1
    chosen = share_of(list(zip(parts, names, strict=True)), how)
    kept = [part for part, _ in chosen]
    found, problems, failures = work_on(kept, [name for _, name in chosen], work, how, progress)
    return OfEach([each for each in found if each is not None], single, problems, failures)


def all_scenes(scenes: Sequence[str]) -> list[Loaded[SceneRecipe]]:
    """All recipes, or all that is wrong with any of them."""
    from ..recipe import load_scene

    return all_of(scenes, load_scene)


def all_of(names: Sequence[str], load: Callable[[str], R]) -> list[R]:
    """What `load` makes of each name. Raises InputError with all that is wrong with any of them."""
    loaded: list[R] = []
    problems: list[str] = []
    for name in names:
        try:
            loaded.append(load(name))
        except InputError as error:
            problems += error.problems
    if problems:
        raise InputError(problems)
    return loaded
