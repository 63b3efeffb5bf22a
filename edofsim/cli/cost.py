"""`edofsim cost`."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..core.progress import Progress, part
from ..options import CameraOption, ResampleOption, Scenes, Spreading, Work
from ..record import writable_folder
from .many import OfScene, all_of, of_each, seen_by, spread_of
from .shared import Done, begun, finish, inputs_of, recipes_of

if TYPE_CHECKING:
    from ..experiments.cost import Measured
    from ..experiments.cost_stages import Point
    from ..recipe import CameraRecipe, Loaded, SceneRecipe

SEEDS = 3
"""Draws of the sensor's noise to score."""


def cost(
    scenes: Scenes,
    camera: CameraOption = None,
    resample: ResampleOption = False,
    repeats: Annotated[
        int, typer.Option("--repeats", min=1, help="Timed repeats of each case, interleaved.")
    ] = 3,
    *,
    spread: Spreading,
    to: Work,
) -> Done:
    """Measure what accuracy costs in time.

    It measures error and seconds for targets from 25 to 60 dB and without each effect in turn, and how far
    the restored PSNR and the gain over the lens alone shift. It measures the noise of renderings with more
    and more samples, and every network. It writes tables, CSV, charts and a page of each scene. The same
    command resumes interrupted work.

    With --jobs, scenes are measured at the same time, and their seconds are longer than alone.

    Figures, of several scenes with .SCENE behind: psnr_db.CASE, predicted_db.CASE, seconds.CASE[.STAGE],
    predicted_seconds.CASE for each case target.N_dB, chosen, target.restored, without.EFFECT and full;
    shift_db.CASE.WHAT of the scores NETWORK, Wiener and gain_over_the_lens_alone, noise_db.CASE.WHAT from
    seed to seed; times_faster.chosen;
    render_noise.render.N_samples, seconds.render.N_samples; {psnr_db,psnr_db_se,seconds}.restore.NETWORK.
    """
    pairs = all_of(scenes, lambda scene: recipes_of(scene, camera, resample))
    how = spread_of(spread)
    names = [scene.recipe.name for scene, _ in pairs]
    with begun("cost", to.json, quiet=to.quiet) as progress:
        from ..capture.device import torch_device

        torch_device(to.device.value)
        named = {name: to.out / name if to.out else Path("out") / f"cost-{name}" for name in names}
        folders = [writable_folder(to.out if to.out and len(names) == 1 else named[name]) for name in names]
        work = partial(measured, repeats=repeats, cache=seen_by(how, to.cache), device=to.device.value)
        parts = [(*pair, seen_by(how, folder)) for pair, folder in zip(pairs, folders, strict=True)]
        found = of_each(parts, names, work, how, progress)
        inputs = inputs_of(*pairs[0]) if len(pairs) == 1 else {"scenes": [str(s.path) for s, _ in pairs]}
        done = finish("cost", found.printed, found.figures, found.outputs, to.json, inputs=inputs)
        return replace(done, problems=found.problems, failures=found.failures)


def measured(
    scene_and_place: tuple[Loaded[SceneRecipe], Loaded[CameraRecipe], Path],
    progress: Progress,
    *,
    repeats: int,
    cache: Path | None,
    device: str,
) -> OfScene:
    """What accuracy costs for one scene, in the folder that is given with it."""
    from ..capture.device import torch_device
    from ..capture.framing import seen_through
    from ..experiments import cost as photos
    from ..experiments import cost_stages
    from ..experiments.cost_scores import Judge, restoring
    from ..optics import Camera
    from ..plan import planner_of, through_mask_like
    from ..render import render
    from ..restore import usual_network

    scene, camera_recipe, folder = scene_and_place
    recipe, base, compute = scene.recipe, scene.base, torch_device(device)
    optics = Camera.from_recipe(camera_recipe.recipe, camera_recipe.base)
    _, view = seen_through(
        optics, recipe, render(recipe, base, cache=cache, device=device, progress=progress)
    )
    about = (optics, view.wavelengths, view.inverse_depth)
    network = usual_network(camera_recipe)
    ways = [network, None] if network else [None]
    restorers = {way.name if way else "Wiener": restoring(*about, way) for way in ways}
    planner = planner_of(view, optics, progress=progress)
    alone = optics.without_mask()
    rival = planner_of(view, alone, facts=through_mask_like(planner.facts, alone), progress=progress)
    rows = photos.measure(
        view,
        optics,
        photos.cases_of(planner, alone=rival),
        folder,
        repeats=repeats,
        device=compute,
        judge=Judge(restorers, SEEDS, alone),
        progress=part(progress, 0.0, 0.6),
    )
    points = cost_stages.render_points(
        recipe, base, cache=cache, device=device, progress=part(progress, 0.6, 0.85)
    )
    points += cost_stages.restore_points(
        view, camera_recipe, folder, repeats=repeats, device=compute, progress=part(progress, 0.85, 1.0)
    )
    return _written(recipe.name, folder, rows, points)


def _written(name: str, folder: Path, rows: list[Measured], points: list[Point]) -> OfScene:
    """Tables, charts and the page of what was measured."""
    from ..experiments import cost as photos
    from ..experiments import cost_stages
    from ..experiments.cost_page import (
        cost_page,
        cost_plot,
        photo_table,
        shift_table,
        stage_plot,
        stage_table,
    )

    by_kind = {row.case.kind: row for row in rows}
    saved = by_kind["full"].seconds / by_kind["chosen"].seconds
    numbers = {**photos.figures(rows), **cost_stages.figures(points), "times_faster.chosen": saved}
    outputs = {
        "table": photos.write_table(folder / "cost.csv", rows),
        "table of stages": cost_stages.write_table(folder / "stages.csv", points),
        "chart": cost_plot(rows, name).save(folder / "cost.png"),
    }
    printed = [photo_table(rows), shift_table(rows)]
    for stage in ("render", "restore"):
        some = [point for point in points if point.stage == stage]
        if some:
            outputs[f"chart of {stage}"] = stage_plot(some).save(folder / f"cost-{stage}.png")
            printed.append(stage_table(some))
    outputs["page"] = cost_page(folder / "cost.html", name, rows, points, numbers)
    said = f"the photo of the default choice takes {1 / saved:.1%} of the time of the full simulation's"
    return OfScene(name, [*printed, said], numbers, outputs)
