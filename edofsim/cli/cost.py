"""`edofsim cost`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ..core.progress import part
from ..options import (
    CacheOption,
    CameraOption,
    Device,
    DeviceOption,
    JsonOption,
    OutOption,
    QuietOption,
    Scene,
)
from ..record import writable_folder
from .shared import Done, begun, finish, inputs_of, recipes_of

SEEDS = 3
"""Draws of the sensor's noise that scores are told for."""


def cost(
    scene: Scene,
    camera: CameraOption = None,
    repeats: Annotated[int, typer.Option("--repeats", min=1, help="Of each measurement, in turns.")] = 3,
    out: OutOption = None,
    json: JsonOption = None,
    cache: CacheOption = None,
    device: DeviceOption = Device.auto,
    quiet: QuietOption = False,
) -> Done:
    """What accuracy costs: measured error against seconds for targets from 25 to 60 dB, and with each effect
    left out in turn, and how far the PSNR of the restored photo and its gain over the lens alone shift; noise
    of rendering with more and more samples; every network's restoration. Tables, CSV, charts and a page.
    Interrupt it at any time: the same command goes on from there.

    Figures: psnr_db.CASE, predicted_db.CASE, seconds.CASE[.STAGE], predicted_seconds.CASE for each case
    target.N_dB, chosen, score.score_0.1_dB, without.EFFECT and full; shift_db.CASE.WHAT of the scores
    NETWORK, Wiener and gain_over_the_lens_alone, noise_db.CASE.WHAT from seed to seed; times_faster.chosen;
    render_noise.render.N_samples, seconds.render.N_samples; psnr_db.restore.NETWORK, seconds.restore.NETWORK.
    """
    scene_recipe, camera_recipe = recipes_of(scene, camera)
    folder = writable_folder(out or Path("out") / f"cost-{scene_recipe.recipe.name}")
    with begun("cost", json, quiet=quiet) as progress:
        from ..capture.device import torch_device
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
        from ..experiments.cost_scores import Judge
        from ..optics import Camera
        from ..plan import planner_of
        from ..render import render
        from ..restore.checkpoint import network_of
        from ..restore.choice import restoring

        compute = torch_device(device.value)
        recipe, base = scene_recipe.recipe, scene_recipe.base
        optics = Camera.from_recipe(camera_recipe.recipe, camera_recipe.base)
        view = render(recipe, base, cache=cache, device=device.value, progress=progress)
        about = (optics, view.wavelengths, view.inverse_depth)
        network = network_of(camera_recipe)
        ways = [network, None] if network else [None]
        restorers = {way.name if way else "Wiener": restoring(*about, way) for way in ways}
        restore = restoring(*about, network)
        rows = photos.measure(
            view,
            optics,
            photos.cases_of(planner_of(view, optics, restore=restore, progress=progress)),
            folder,
            repeats=repeats,
            device=compute,
            judge=Judge(restorers, SEEDS, optics.without_mask()),
            progress=part(progress, 0.0, 0.6),
        )
        points = cost_stages.render_points(
            recipe, base, cache=cache, device=device.value, progress=part(progress, 0.6, 0.85)
        )
        points += cost_stages.restore_points(
            view, camera_recipe, folder, repeats=repeats, device=compute, progress=part(progress, 0.85, 1.0)
        )
        by_kind = {row.case.kind: row for row in rows}
        saved = by_kind["full"].seconds / by_kind["chosen"].seconds
        numbers = {**photos.figures(rows), **cost_stages.figures(points), "times_faster.chosen": saved}
        outputs = {
            "table": photos.write_table(folder / "cost.csv", rows),
            "table of stages": cost_stages.write_table(folder / "stages.csv", points),
            "chart": cost_plot(rows, recipe.name).save(folder / "cost.png"),
        }
        printed = [photo_table(rows), shift_table(rows)]
        for stage in ("render", "restore"):
            some = [point for point in points if point.stage == stage]
            if some:
                outputs[f"chart of {stage}"] = stage_plot(some).save(folder / f"cost-{stage}.png")
                printed.append(stage_table(some))
        outputs["page"] = cost_page(folder / "cost.html", recipe.name, rows, points, numbers)
        said = f"the photo of the default choice takes {1 / saved:.1%} of the time of the full simulation's"
        inputs = inputs_of(scene_recipe, camera_recipe)
        return finish("cost", [*printed, said], numbers, outputs, json, inputs=inputs)
