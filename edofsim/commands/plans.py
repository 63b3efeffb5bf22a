"""`plan` and `cost`: what a scene calls for, and what accuracy costs."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rich.table import Table

from ..record import writable_folder
from .base import Aim, Done, Progress, finish, inputs_of, plan_lines, plan_rows, recipes_of


def plan_scene(
    scene: str,
    camera: str | None,
    overrule: Mapping[str, Any],
    aim: Aim,
    json: Path | None,
    cache: Path | None,
    device: str,
    progress: Progress,
) -> Done:
    """`edofsim plan`: decided on small renderings of the scene unless its view is in the cache."""
    target = aim.target()
    scene_recipe, camera_recipe = recipes_of(scene, camera)
    from ..optics import Camera
    from ..pipeline import plan_figures
    from ..plan import look, plan_scene

    optics = Camera.from_recipe(camera_recipe.recipe, camera_recipe.base)
    looked = look(
        scene_recipe.recipe, scene_recipe.base, optics, cache=cache, device=device, progress=progress
    )
    chosen = plan_scene(looked, optics, overrule=overrule, target=target, progress=progress)
    inputs = inputs_of(scene_recipe, camera_recipe)
    numbers = plan_figures(chosen)
    return finish("plan", plan_lines(chosen), numbers, {}, json, inputs=inputs, plan=plan_rows(chosen))


def cost_scene(
    scene: str,
    camera: str | None,
    repeats: int,
    out: Path | None,
    json: Path | None,
    cache: Path | None,
    device: str,
    progress: Progress,
) -> Done:
    """`edofsim cost`."""
    scene_recipe, camera_recipe = recipes_of(scene, camera)
    folder = writable_folder(out or Path("out") / f"cost-{scene_recipe.recipe.name}")
    from ..experiments import cost, cost_stages
    from ..optics import Camera
    from ..pipeline import torch_device
    from ..plan import planner_of
    from ..render import render
    from ..report.cost_chart import cost_plot
    from ..report.cost_page import cost_page, stage_plot

    optics = Camera.from_recipe(camera_recipe.recipe, camera_recipe.base)
    view = render(scene_recipe.recipe, scene_recipe.base, cache=cache, device=device, progress=progress)
    planner = planner_of(view, optics, progress=progress)
    rows = cost.measure(
        view,
        optics,
        cost.cases_of(planner),
        folder,
        repeats=repeats,
        device=torch_device(device),
        progress=_part(progress, 0.0, 0.6),
    )
    points = cost_stages.render_points(
        scene_recipe.recipe,
        scene_recipe.base,
        cache=cache,
        device=device,
        progress=_part(progress, 0.6, 0.85),
    )
    points += cost_stages.restore_points(
        view,
        camera_recipe,
        folder,
        repeats=repeats,
        device=torch_device(device),
        progress=_part(progress, 0.85, 1.0),
    )
    table = Table("", "case", "PSNR / dB", "predicted", "seconds", "predicted", *cost.STAGES, box=None)
    for row in rows:
        table.add_row(
            row.case.kind,
            row.case.name,
            f"{row.measured_db:.1f}",
            f"{row.case.predicted_db:.1f}",
            f"{row.seconds:.2f}",
            f"{row.case.predicted_seconds:.2f}",
            *(f"{row.stages[stage]:.2f}" for stage in cost.STAGES),
        )
    by_kind = {row.case.kind: row for row in rows}
    saved = by_kind["full"].seconds / by_kind["chosen"].seconds
    numbers = {**cost.figures(rows), **cost_stages.figures(points), "times_faster.chosen": saved}
    name = scene_recipe.recipe.name
    outputs = {
        "table": cost.write_table(folder / "cost.csv", rows),
        "table of stages": cost_stages.write_table(folder / "stages.csv", points),
        "chart": cost_plot(rows, name).save(folder / "cost.png"),
    }
    others = Table("stage", "with", "noise or PSNR", "seconds", "", box=None)
    for stage in ("render", "restore"):
        some = [point for point in points if point.stage == stage]
        if some:
            outputs[f"chart of {stage}"] = stage_plot(some).save(folder / f"cost-{stage}.png")
        for point in some:
            value = f"{point.value:.2%}" if stage == "render" else f"{point.value:.2f} dB"
            others.add_row(stage, point.name, value, f"{point.seconds:.2f}", "by default" * point.chosen)
    outputs["page"] = cost_page(folder / "cost.html", name, rows, points, numbers)
    said = f"the photo of the default choice takes {1 / saved:.1%} of the time of the full simulation's"
    lines = [table, others, said]
    return finish("cost", lines, numbers, outputs, json, inputs=inputs_of(scene_recipe, camera_recipe))


def _part(progress: Progress, start: float, end: float) -> Progress:
    """Progress of a part as progress of the whole."""
    return lambda done, text: progress(start + done * (end - start), text)
