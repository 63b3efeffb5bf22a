"""What commands share: how a command ends, what it prints and records."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rich.table import Table

from .. import console
from ..errors import InputError
from ..recipe import CameraRecipe, Loaded, SceneRecipe, load_camera, load_scene
from ..record import record, write_record

Progress = Callable[[float, str], None]


@dataclass(frozen=True)
class Aim:
    """What a user asks a plan for, as typed: `--accuracy` or `--time`."""

    accuracy: str | None = None
    time: str | None = None

    def target(self) -> Any:
        """As `edofsim.plan.Target`. Raises InputError for what cannot be read."""
        from ..plan import parse_target

        return parse_target(self.accuracy, self.time)


@dataclass(frozen=True)
class Done:
    """The end of a command: what it prints, last of all the paths of what it wrote. problems: what could not
    be used while the rest was finished."""

    printed: Sequence[str | Table] = ()
    outputs: Mapping[str, Path] = field(default_factory=dict)
    problems: Sequence[str] = ()

    def show(self) -> None:
        """Print it. Raises InputError at the end if there were problems."""
        for item in self.printed:
            console.out.print(item, markup=False) if isinstance(item, str) else console.out.print(item)
        console.show_outputs(self.outputs)
        if self.problems:
            raise InputError(self.problems)


def recipes_of(scene: str, camera: str | None) -> tuple[Loaded[SceneRecipe], Loaded[CameraRecipe]]:
    """Both recipes, with the problems of both if both have any."""
    problems: list[str] = []
    scene_recipe = camera_recipe = None
    try:
        scene_recipe = load_scene(scene)
    except InputError as error:
        problems += error.problems
    if camera or scene_recipe:
        try:
            base = scene_recipe.base if scene_recipe and not camera else None
            camera_recipe = load_camera(camera or scene_recipe.recipe.camera, base)
        except InputError as error:
            problems += error.problems
    if problems:
        raise InputError(problems)
    return scene_recipe, camera_recipe


def inputs_of(scene: Loaded[SceneRecipe], camera: Loaded[CameraRecipe], **more: Any) -> dict[str, Any]:
    return {"scene": str(scene.path), "camera": str(camera.path)} | {
        k: str(v) for k, v in more.items() if v is not None
    }


def finish(
    command: str,
    printed: Sequence[str | Table],
    numbers: Mapping[str, float],
    outputs: Mapping[str, Path],
    json: Path | None,
    **more: Any,
) -> Done:
    if json:
        outputs = {**outputs, "json": json}
        write_record(json, record(command, figures=numbers, outputs=outputs, **more))
    return Done(printed, outputs)


def experiment(
    command: str, numbers: Mapping[str, float], folder: Path, json: Path | None, inputs: dict[str, Any]
) -> Done:
    table = Table("figure", "value", box=None)
    for name, value in numbers.items():
        table.add_row(name, f"{value:.6g}")
    outputs = {path.name: path for path in sorted(folder.iterdir()) if path.is_file()}
    return finish(command, [table], numbers, outputs, json, inputs=inputs)


def plan_rows(plan: Any) -> list[dict[str, Any]]:
    return [vars(decision) for decision in plan.decisions]


def plan_lines(plan: Any) -> list[str | Table]:
    """The plan's table, and what it comes to as a whole."""
    from ..plan import decibels, overall

    table = Table("effect", "called for", "simulated", "left out / dB", "cost / s", "why", box=None)
    for d in plan.decisions:
        table.add_row(
            d.effect,
            "yes" if d.called_for else "no",
            d.chosen + (" (overruled)" if d.overruled else ""),
            f"{decibels(overall(d.error)):.1f}" if d.error is not None else "",
            f"{d.seconds:.2f}" if d.error is not None else "",
            d.why,
        )
    stages = ", ".join(f"{stage} {value:.2g} s" for stage, value in plan.seconds.items() if value)
    summary = (
        f"asked for: {plan.target}; predicted {plan.error_db:.1f} dB in {sum(plan.seconds.values()):.2g} s "
        f"({stages}), {plan.memory_mib:.0f} MiB of memory, {plan.disk_mib:.0f} MiB of disk"
    )
    return [table, summary, *([plan.note] if plan.note else [])]
