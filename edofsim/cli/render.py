"""`edofsim render`."""

from __future__ import annotations

import math
import time as clock
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from .. import console
from ..core.progress import Progress
from ..errors import EdofsimError, InputError
from ..options import AccuracyOption, Scenes, Spreading, TimeOption, Work
from ..record import peak_memory_mib, processor_seconds, writable_folder
from .many import all_scenes, spread_of
from .shared import Done, begun, finish, load_report

if TYPE_CHECKING:
    from ..plan import Target
    from ..recipe import Loaded, SceneRecipe
    from ..render.jobs import RenderOutcome, Task


VariantsOption = Annotated[
    int | None, typer.Option("--members", min=1, help="Number of variants of each family.")
]
NoiseOption = Annotated[
    str | None,
    typer.Option(
        "--noise",
        metavar="1%|photo|truth",
        help="Stop at this relative noise of the view, not at a sample count. photo: about a tenth "
        "of the sensor's noise. truth: about 45 dB in the ideal image.",
    ),
]


def render(
    scenes: Scenes,
    members: VariantsOption = None,
    accuracy: AccuracyOption = None,
    time: TimeOption = None,
    noise: NoiseOption = None,
    *,
    spread: Spreading,
    work: Work,
) -> Done:
    """Render views into the cache.

    With --out, it writes a picture and a depth picture of each view.

    A view serves every camera, so all of a recipe is rendered, unless --accuracy or --time asks for what a
    photo through the scene's own camera calls for. The same command resumes interrupted work.

    Figures: views, views.rendered, seconds.{forecast,render} (of all views, added up), seconds.total (until
    the last was there), seconds.processor (of all cores and workers of this machine, start included),
    seconds.SCENE, render_noise.SCENE, peak_memory_mib.
    """
    started = clock.perf_counter()
    place = noise if noise in ("photo", "truth") else ""
    level = _fraction(noise, "--noise") if noise and not place else None
    loaded = all_scenes(scenes)  # every recipe is checked before any time is spent
    how = spread_of(spread)
    folder = writable_folder(work.out) if work.out else None
    with begun("render", work.json, quiet=work.quiet) as progress:
        from ..render import cache as store
        from ..render.jobs import MANIFEST, Task, check_scenes, forecast, render_many, render_one

        if folder:
            load_report()
        loaded = [_framed(item) for item in loaded]
        tasks = _tasks(loaded, members)
        if accuracy or time or place:
            from ..plan import parse_target

            target = parse_target(accuracy, time) if accuracy or time else None
            tasks = [_for_own_camera(task, target, place, work, progress) for task in tasks]
        if len(tasks) > 1:
            check_scenes([Task(item.recipe, item.base) for item in loaded], progress)
        expected = forecast(tasks, cache=work.cache, jobs=spread.jobs, noise=level)
        if not work.quiet:
            console.err.print(str(expected), markup=False)
        given = {"cache": work.cache, "noise": level, "device": work.device.value, "progress": progress}
        single = len(tasks) == 1 and how.alone and how.shard is None  # no worker needs starting for one view
        many = {"jobs": how.jobs, "cluster": how.cluster, "shard": how.shard}
        done = [render_one(tasks[0], **given)] if single else render_many(tasks, **many, **given)
        outcomes, failed = _parted(done)
        table, numbers = _render_table(outcomes, expected.seconds, clock.perf_counter() - started)
        manifest = (work.cache or store.default_folder()) / MANIFEST
        outputs = {"manifest": manifest} if numbers["views.rendered"] else {}
        if folder:
            outputs |= _view_pictures(tasks, folder, level, work.cache)
        numbers["peak_memory_mib"] = peak_memory_mib()
        inputs = {"scenes": [str(item.path) for item in loaded], "members": members, "noise": place or level}
        return replace(finish("render", [table], numbers, outputs, work.json, inputs=inputs), failures=failed)


def _tasks(scenes: Sequence[Loaded[SceneRecipe]], members: int | None) -> list[Task]:
    """A task a scene, or a member of its family."""
    from ..render.jobs import Task
    from ..scene.family import members as family_members

    return [
        Task(recipe, item.base)
        for item in scenes
        for recipe in (family_members(item.recipe, members) if members else [item.recipe])
    ]


def _parted(outcomes: Sequence[RenderOutcome]) -> tuple[list[RenderOutcome], list[str]]:
    """Those that are there, and sentences of those that failed. Raises EdofsimError where none is there."""
    failed = [f"{outcome.name}: {outcome.error}" for outcome in outcomes if outcome.error]
    there = [outcome for outcome in outcomes if not outcome.error]
    if failed and not there:
        raise EdofsimError("\n".join(failed))
    return there, failed


def _render_table(
    outcomes: Sequence[RenderOutcome], forecast: float, total: float
) -> tuple[Table, dict[str, float]]:
    """Of each view, and of all: a table and figures. forecast, total: seconds."""
    numbers: dict[str, float] = {
        "views": len(outcomes),
        "views.rendered": sum(outcome.fresh for outcome in outcomes),
        "seconds.forecast": forecast,
        "seconds.render": sum(outcome.seconds for outcome in outcomes),
        "seconds.total": total,
        "seconds.processor": processor_seconds(),
    }
    table = Table("view", "seconds", "samples", "noise", "host", "from", box=None)
    for each in outcomes:
        origin = "rendered" if each.fresh else each.origin
        cells = (f"{each.seconds:.1f}", str(each.samples), f"{each.noise:.2%}", each.host, origin)
        table.add_row(each.name, *cells)
        numbers[f"seconds.{each.name}"] = each.seconds
        numbers[f"render_noise.{each.name}"] = each.noise
    return table, numbers


def _framed(scene: Loaded[SceneRecipe]) -> Loaded[SceneRecipe]:
    """A scene as its own camera frames it; one that gives its pixels' angle is rendered so, for any."""
    from .angles import framed_by_own

    if not scene.recipe.follows_camera:
        return scene
    return replace(scene, recipe=framed_by_own(scene.recipe, scene.base))


def _for_own_camera(task: Task, target: Target | None, place: str, work: Work, progress: Progress) -> Task:
    """A task without what the photo through the scene's own camera does not call for at a target; and that
    stops where noise is low enough in the photo or in the ideal image of that camera. By a preview, whatever
    the cache holds."""
    from ..optics import Camera
    from ..plan import look, plan_scene, simpler_recipe
    from ..plan.rendered_noise import view_noise_for
    from ..recipe import load_camera

    camera = load_camera(task.recipe.camera, task.base)
    optics = Camera.from_recipe(camera.recipe, camera.base)
    how = {"cache": work.cache, "device": work.device.value, "progress": progress}
    said = []
    if target is not None:
        seen = look(task.recipe, task.base, optics, preview=True, **how)
        plan = plan_scene(seen, optics, target=target, progress=progress)
        task = replace(task, recipe=simpler_recipe(task.recipe, plan.fidelity))
        said.append(f"planned for {plan.target}")
    if place:
        level = view_noise_for(look(task.recipe, task.base, optics, preview=True, **how).facts, place)
        task = replace(task, noise=level)
        said += [] if level is None else [f"noise {level:.3g} of the view is low enough for {place}"]
    for text in () if work.quiet else said:
        console.err.print(f"{task.recipe.name}: {text}", markup=False)
    return task


def _view_pictures(
    tasks: Sequence[Task], folder: Path, noise: float | None, cache: Path | None
) -> dict[str, Path]:
    from ..capture import save_image
    from ..render import finished
    from ..report import depth_plot

    outputs: dict[str, Path] = {}
    for task in tasks:
        view = finished(task.recipe, task.base, cache=cache, noise=task.stops_at(noise))
        if view is None:  # of another shard, or failed
            continue
        name = task.recipe.name
        outputs[f"{name} picture"] = save_image(folder / f"{name}.png", view.picture())
        depth = view.crop_margin(view.mean_inverse_depth())
        outputs[f"{name} depth"] = depth_plot(depth).save(folder / f"{name}-depth.png")
    return outputs


def _fraction(text: str, option: str) -> float:
    """`1%` or `0.01` as 0.01."""
    try:
        value = float(text.removesuffix("%")) * (0.01 if text.endswith("%") else 1.0)
    except ValueError:
        value = math.nan
    if not 0 < value < 1:
        raise InputError(
            f"{option} {text}: give a fraction above 0 and below 1, such as 1% or 0.01, photo or truth"
        )
    return value
