"""`evaluate paper`: all of the paper's experiments, one after the other, and the index over their pages."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from ..errors import EdofsimError, InputError
from ..record import writable_folder
from . import paper
from .base import Done, Progress
from .deep_scenes import evaluate_bench_scene, evaluate_scene3d

LOG = logging.getLogger(__name__)
FEW_PHOTOGRAPHS = 4
SCENES = ("desk",)


@dataclass(frozen=True)
class Setting:
    """What all experiments share. photos, chart, cubes: None for what ships or is drawn; full: the paper's
    sizes instead of small ones; out: folder of the experiments' folders; limit: photographs to use."""

    out: Path
    photos: Path | None
    chart: Path | None
    cubes: Path | None
    full: bool
    seed: int
    cache: Path | None

    @property
    def limit(self) -> int | None:
        return None if self.full else FEW_PHOTOGRAPHS

    @property
    def systems(self) -> list[str] | None:
        """All systems, or the networks where time is short."""
        from ..restore.checkpoint import shipped_checkpoints

        return None if self.full else list(shipped_checkpoints())


@dataclass(frozen=True)
class Step:
    """An experiment: its name, which is that of its folder too, and what runs it."""

    name: str
    run: Callable[[Setting, Path, Progress], Done]


def _table(s: Setting, out: Path, progress: Progress) -> Done:
    return paper.evaluate_table(s.photos, None, s.chart, None, s.limit, s.seed, out, None, progress)


def _noise(s: Setting, out: Path, progress: Progress) -> Done:
    return paper.evaluate_noise(s.photos, s.systems, None, s.limit, s.seed, out, None, progress)


def _fabrication(s: Setting, out: Path, progress: Progress) -> Done:
    return paper.evaluate_fabrication(s.photos, s.systems, None, s.limit, s.seed, out, None, progress)


def _broadband(s: Setting, out: Path, progress: Progress) -> Done:
    cubes = [s.cubes] if s.cubes else []
    return paper.evaluate_broadband(cubes, SCENES, {}, s.systems, s.seed, out, None, s.cache, progress)


def _scene3d(s: Setting, out: Path, progress: Progress) -> Done:
    return evaluate_scene3d((), (), None, not s.full, s.seed, out, None, s.cache, progress)


def _bench_scene(s: Setting, out: Path, progress: Progress) -> Done:
    return evaluate_bench_scene((), None, not s.full, s.seed, out, None, s.cache, progress)


STEPS = (
    Step("bandwidth", lambda s, out, progress: paper.evaluate_bandwidth(out, None)),
    Step("mtf", lambda s, out, progress: paper.evaluate_mtf(None, out, None)),
    Step("table", _table),
    Step("noise", _noise),
    Step("fabrication", _fabrication),
    Step("broadband", _broadband),
    Step("scene3d", _scene3d),
    Step("bench-scene", _bench_scene),
)


def evaluate_paper(setting: Setting, only: Sequence[str], progress: Progress) -> Done:
    """Run all experiments, or those in `only`. One that fails is named, and the others are run.

    Raises InputError for unknown names, and EdofsimError after the others where any failed.
    """
    from ..report.experiments_index import write_index

    known = [step.name for step in STEPS]
    wrong = [name for name in only if name not in known]
    if wrong:
        raise InputError(f"no experiment {wrong[0]!r}; there are {', '.join(known)}")
    steps = [step for step in STEPS if not only or step.name in only]
    folder = writable_folder(setting.out)
    outputs: dict[str, Path] = {}
    problems: list[str] = []
    failed: list[str] = []
    for number, step in enumerate(steps):

        def say(done: float, text: str, number: int = number, name: str = step.name) -> None:
            progress((number + done) / len(steps), f"{name}: {text}")

        say(0.0, "begins")
        try:
            found = step.run(setting, folder / step.name, say)
        except EdofsimError as error:
            LOG.warning("%s: %s (the others go on)", step.name, error)
            failed.append(step.name)
            continue
        page = next((path for path in found.outputs.values() if path.suffix == ".html"), None)
        if page is not None:
            outputs[step.name] = page
        problems += found.problems
        outputs["index"] = write_index(folder)
    if failed:
        raise EdofsimError(f"{', '.join(failed)}: failed as told above; the others are in {folder}")
    return Done(outputs=outputs, problems=problems)
