"""What commands share: how they begin, what they print and record, how they end."""

from __future__ import annotations

from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from importlib import import_module
from pathlib import Path
from threading import Thread
from typing import TYPE_CHECKING

from rich.table import Table

from .. import console
from ..core.progress import Progress
from ..errors import EdofsimError, InputError
from ..options import Simulated
from ..record import record, writable_file, write_record

if TYPE_CHECKING:
    from ..plan import Plan
    from ..recipe import CameraRecipe, Loaded, SceneRecipe
    from ..report import Table as PageTable


@dataclass(frozen=True)
class Done:
    """The end of a command: what it prints, last of all the paths of what it wrote. problems: what could not
    be used while the rest was finished; failures: what was begun and did not succeed."""

    printed: Sequence[str | Table | PageTable] = ()
    outputs: Mapping[str, Path] = field(default_factory=dict)
    problems: Sequence[str] = ()
    failures: Sequence[str] = ()

    def show(self) -> None:
        """Print it. Raises InputError at the end if there were problems, EdofsimError for failures."""
        for item in self.printed:
            if isinstance(item, str):
                console.out.print(item, markup=False)
            else:
                console.out.print(item if isinstance(item, Table) else _as_text(item))
        console.show_outputs(self.outputs)
        if self.problems:
            raise InputError(self.problems)
        if self.failures:
            raise EdofsimError("\n".join(self.failures))


def load_report() -> None:
    """Load what scores images and draws plots and pages while other work goes on: it takes half a second."""

    def load() -> None:
        for name in ("skimage.metrics", "edofsim.report"):
            import_module(name)

    Thread(target=load, daemon=True).start()


@contextmanager
def begun(title: str, json: Path | None, *, quiet: bool = False) -> Generator[Progress]:
    """Progress of a command, once it is known that its figures can be written. Raises InputError."""
    if json:
        writable_file(json)
    with console.progress(title, quiet=quiet) as progress:
        yield progress


def recipes_of(
    scene: str, camera: str | None, resample: bool = False
) -> tuple[Loaded[SceneRecipe], Loaded[CameraRecipe]]:
    """Both recipes, with the problems of both if both have any, the scene as the camera frames it: see
    `framed`."""
    from ..capture.framing import framed
    from ..optics import Camera
    from ..recipe import load_camera, load_scene

    try:
        loaded = load_scene(scene)
    except InputError as error:
        problems = list(error.problems)
        if camera:
            try:
                load_camera(camera)
            except InputError as other:
                problems += other.problems
        raise InputError(problems) from None
    found = load_camera(camera) if camera else load_camera(loaded.recipe.camera, loaded.base)
    optics = Camera.from_recipe(found.recipe, found.base)
    return replace(loaded, recipe=framed(loaded.recipe, optics, resample)), found


def check_alone(simulated: Simulated, **more: object) -> None:
    """Refuse a fidelity that cannot be read, and what would choose next to it. Raises InputError."""
    from ..capture.fidelity import Fidelity
    from ..capture.presets import PRESETS

    fidelity = simulated.fidelity
    if fidelity is not None and fidelity not in PRESETS:
        if not Path(fidelity).is_file():
            raise InputError(f"--fidelity {fidelity}: no such file, and presets are {', '.join(PRESETS)}")
        Fidelity.load(fidelity)
    others = {**vars(simulated), "fidelity": None, **more}
    given = [f"--{name.strip('_').replace('_', '-')}" for name, value in others.items() if value is not None]
    if fidelity is not None and given:
        raise InputError(f"--fidelity says all that is simulated: leave out {', '.join(given)}")


def inputs_of(scene: Loaded[SceneRecipe], camera: Loaded[CameraRecipe], **more: object) -> dict[str, object]:
    said = {name: str(value) for name, value in more.items() if value is not None}
    return {"scene": str(scene.path), "camera": str(camera.path), **said}


def finish(
    command: str,
    printed: Sequence[str | Table | PageTable],
    figures: Mapping[str, float],
    outputs: Mapping[str, Path],
    json: Path | None,
    *,
    problems: Sequence[str] = (),
    seed: int | None = None,
    inputs: Mapping[str, object] | None = None,
    rest: Mapping[str, object] | None = None,
    **more: object,
) -> Done:
    """The end of a command, after its figures are written. rest, more: of the record."""
    more |= rest or {}
    if json:
        outputs = {**outputs, "json": json}
        write_record(
            json, record(command, figures=figures, seed=seed, inputs=inputs, outputs=outputs, **more)
        )
    return Done(printed, outputs, problems)


def figures_table(figures: Mapping[str, float]) -> Table:
    table = Table("figure", "value", box=None)
    for name, value in figures.items():
        table.add_row(name, f"{value:.6g}")
    return table


def plan_rows(plan: Plan) -> list[dict[str, object]]:
    return [vars(decision) for decision in plan.decisions]


def plan_lines(plan: Plan, planning: float | None = None) -> list[str | Table]:
    """The plan's table, and what it comes to as a whole. planning: seconds that making it took."""
    table = Table(*plan.HEADS, box=None)
    for row in plan.rows():
        table.add_row(*row)
    took: list[str | Table] = []
    if planning is not None:
        took = [f"planned in {planning:.2g} s"]
        if plan.saves() > 0:
            took = [f"{took[0]}, {planning / plan.saves():.1%} of the {plan.saves():.2g} s that it saves"]
    return [table, plan.summary(), *took, *([plan.note] if plan.note else [])]


def _as_text(table: PageTable) -> Table:
    """A page's table for a terminal: the units next to the names, the remarks below the values."""
    heads = (f"{column.name} / {column.unit}" if column.unit else column.name for column in table.columns)
    text = Table(*heads, box=None)
    for cells in table.cells():
        text.add_row(*("\n".join(filter(None, (value, remark))) for value, remark, _ in cells))
    return text
