"""Commands from a scene recipe to views, photos, plans and costs."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.table import Table

from .. import console
from ..errors import EdofsimError, InputError
from ..recipe import Loaded, SceneRecipe, load_camera, load_scene
from ..record import peak_memory_mib, record, writable_folder, write_record
from .base import Aim, Done, Progress, finish, inputs_of, plan_lines, plan_rows, recipes_of


def run_scene(
    scene: str,
    camera: str | None,
    network: str | None,
    overrule: Mapping[str, Any],
    aim: Aim,
    cost: bool,
    seed: int,
    out: Path | None,
    json: Path | None,
    cache: Path | None,
    device: str,
    progress: Progress,
) -> Done:
    """`edofsim run`."""
    target = aim.target()
    scene_recipe, camera_recipe = recipes_of(scene, camera)
    folder = writable_folder(out or Path("out") / scene_recipe.recipe.name)
    from .. import pipeline
    from ..capture import write_photo
    from ..report import save_srgb, write_run_report

    result = pipeline.run(
        scene_recipe,
        camera_recipe,
        cache=cache,
        network=network,
        overrule=overrule,
        target=target,
        seed=seed,
        device=device,
        progress=progress,
    )
    progress(0.98, "report")
    started = time.perf_counter()
    rows = _cost_of(result, folder, progress) if cost else []
    report = write_run_report(folder / "report.html", result, rows)
    numbers = pipeline.figures(result)
    numbers["seconds.report"] = time.perf_counter() - started
    numbers["seconds.total"] += numbers["seconds.report"]
    numbers["peak_memory_mib"] = peak_memory_mib()
    images = {
        "ideal": result.photo.ideal,
        "photo": result.photo.image,
        "restored": result.restored,
        "lens-alone": result.lens_alone.image,
    }
    if result.wiener is not None:
        images["wiener"] = result.wiener
    outputs = {name: save_srgb(folder / f"{name}.png", image) for name, image in images.items()}
    outputs["photo (EXR, linear)"] = write_photo(folder / "photo.exr", result.photo)
    outputs["report"] = report
    if json:
        outputs["json"] = json
        content = record(
            "run",
            figures=numbers,
            seed=seed,
            inputs=inputs_of(scene_recipe, camera_recipe, network=network),
            outputs=outputs,
            plan=plan_rows(result.plan),
            settings=vars(result.plan.fidelity),
            restored_by=result.restored_by,
        )
        write_record(json, content)
    lines = [
        *plan_lines(result.plan),
        _score_table(result),
        f"render {numbers['seconds.render']:.1f} s, expose {numbers['seconds.expose']:.1f} s, "
        f"in all {numbers['seconds.total']:.1f} s; peak memory {numbers['peak_memory_mib']:.0f} MiB",
    ]
    return Done(lines, outputs)


def _cost_of(result: Any, folder: Path, progress: Progress) -> list[Any]:
    """What accuracy costs for the photo of a run, measured in its folder."""
    from ..experiments import cost
    from ..plan import planner_of

    planner = planner_of(result.view, result.optics)
    return cost.measure(
        result.view,
        result.optics,
        cost.cases_of(planner),
        folder,
        repeats=1,
        progress=progress,
    )


def render_scenes(
    scenes: Sequence[str],
    members: int | None,
    aim: Aim,
    noise: str | None,
    jobs: int,
    cluster: str | None,
    shard: str | None,
    out: Path | None,
    json: Path | None,
    cache: Path | None,
    device: str,
    progress: Progress,
) -> Done:
    """`edofsim render`."""
    target = _fraction(noise, "--noise") if noise else None
    part = _shard(shard) if shard else None
    loaded = _all_scenes(scenes)  # every recipe is checked before any time is spent
    folder = writable_folder(out) if out else None
    from ..render.jobs import MANIFEST, Task, forecast, render_many, render_one
    from ..scene.family import members as family_members

    tasks = [
        Task(recipe, item.base)
        for item in loaded
        for recipe in (family_members(item.recipe, members) if members else [item.recipe])
    ]
    if aim.accuracy or aim.time:
        tasks = [_as_planned(task, aim, cache, device, progress) for task in tasks]
    expected = forecast(tasks, cache=cache, jobs=jobs, noise=target)
    console.err.print(str(expected), markup=False)
    if len(tasks) == 1 and not cluster and part is None:  # no worker needs starting for one view
        outcomes = [render_one(tasks[0], cache=cache, noise=target, device=device, progress=progress)]
    else:
        outcomes = render_many(
            tasks,
            cache=cache,
            jobs=jobs,
            cluster=cluster,
            shard=part,
            noise=target,
            device=device,
            progress=progress,
        )
    failed = [f"{outcome.name}: {outcome.error}" for outcome in outcomes if outcome.error]
    if failed:
        raise EdofsimError("\n".join(failed))
    fresh = sum(outcome.fresh for outcome in outcomes)
    numbers: dict[str, float] = {
        "views": len(outcomes),
        "views.rendered": fresh,
        "seconds.forecast": expected.seconds,
        "seconds.render": sum(outcome.seconds for outcome in outcomes),
    }
    table = Table("view", "seconds", "samples", "noise", "host", "from", box=None)
    for outcome in outcomes:
        origin = "rendered" if outcome.fresh else "cache"
        table.add_row(
            outcome.name,
            f"{outcome.seconds:.1f}",
            str(outcome.samples),
            f"{outcome.noise:.2%}",
            outcome.host,
            origin,
        )
        numbers[f"seconds.{outcome.name}"] = outcome.seconds
        numbers[f"render_noise.{outcome.name}"] = outcome.noise
    from ..render import cache as store

    outputs = {"manifest": (cache or store.default_folder()) / MANIFEST} if fresh else {}
    if folder:
        outputs |= _view_pictures(tasks, folder, target, cache)
    numbers["peak_memory_mib"] = peak_memory_mib()
    inputs = {"scenes": [str(item.path) for item in loaded], "members": members, "noise": target}
    return finish("render", [table], numbers, outputs, json, inputs=inputs)


def _as_planned(task: Any, aim: Aim, cache: Path | None, device: str, progress: Progress) -> Any:
    """A task without what the photo through the scene's own camera does not call for."""
    from ..optics import Camera
    from ..plan import look, plan_scene, simpler_recipe
    from ..render.jobs import Task

    target = aim.target()
    camera = load_camera(task.recipe.camera, task.base)
    optics = Camera.from_recipe(camera.recipe, camera.base)
    looked = look(task.recipe, task.base, optics, cache=cache, device=device, progress=progress)
    plan = plan_scene(looked, optics, target=target, progress=progress)
    console.err.print(f"{task.recipe.name}: planned for {plan.target}", markup=False)
    return Task(simpler_recipe(task.recipe, plan.fidelity), task.base)


def _view_pictures(
    tasks: Sequence[Any], folder: Path, noise: float | None, cache: Path | None
) -> dict[str, Path]:
    from ..capture import ideal_image
    from ..render import cached
    from ..report import depth_plot, save_srgb

    outputs: dict[str, Path] = {}
    for task in tasks:
        view = cached(task.recipe, task.base, cache=cache, noise=noise)
        if view is None:  # of another shard
            continue
        name = task.recipe.name
        outputs[f"{name} picture"] = save_srgb(folder / f"{name}.png", view.crop_margin(ideal_image(view)))
        depth = view.crop_margin(view.mean_inverse_depth())
        outputs[f"{name} depth"] = depth_plot(depth).save(folder / f"{name}-depth.png")
    return outputs


def _all_scenes(scenes: Sequence[str]) -> list[Loaded[SceneRecipe]]:
    """All recipes, or all that is wrong with any of them."""
    loaded, problems = [], []
    for scene in scenes:
        try:
            loaded.append(load_scene(scene))
        except InputError as error:
            problems += error.problems
    if problems:
        raise InputError(problems)
    return loaded


def _fraction(text: str, option: str) -> float:
    """`1%` or `0.01` as 0.01."""
    try:
        value = float(text.removesuffix("%")) * (0.01 if text.endswith("%") else 1.0)
    except ValueError:
        value = math.nan
    if not 0 < value < 1:
        raise InputError(f"{option} {text}: give a fraction above 0 and below 1, such as 1% or 0.01")
    return value


def _shard(text: str) -> tuple[int, int]:
    number, slash, count = text.partition("/")
    if not (slash and number.isdigit() and count.isdigit()):
        raise InputError(f"--shard {text}: give I/N, such as 1/4 for the first of four")
    return int(number), int(count)


def expose_scene(
    scene: str,
    camera: str | None,
    overrule: Mapping[str, Any],
    aim: Aim,
    bands: int | None,
    reference: str | None,
    crop: str | None,
    seed: int,
    out: Path | None,
    json: Path | None,
    cache: Path | None,
    device: str,
    progress: Progress,
) -> Done:
    """`edofsim expose`."""
    from ..capture import capture, write_image, write_photo
    from ..capture.bands import merged_bands
    from ..optics import Camera
    from ..pipeline import plan_figures, torch_device, view_as_planned
    from ..plan import look, plan_scene
    from ..reference import check_crop, check_reference, crop_of, reference_photo
    from ..report import save_srgb
    from ..restore.scores import psnr

    target = aim.target()
    if (reference is None) != (crop is None):
        raise InputError("--reference and --crop X,Y,WIDTH,HEIGHT belong together: a reference is slow")
    scene_recipe, camera_recipe = recipes_of(scene, camera)
    optics = Camera.from_recipe(camera_recipe.recipe, camera_recipe.base)
    if reference is not None:
        where = crop_of(crop)
        check_reference(reference, optics)
    folder = writable_folder(out or Path("out") / f"{scene_recipe.recipe.name}-{camera_recipe.recipe.name}")
    started = time.perf_counter()
    looked = look(scene_recipe.recipe, scene_recipe.base, optics, cache=cache, device=device)
    chosen = plan_scene(looked, optics, overrule=overrule, target=target, progress=progress)
    planned = time.perf_counter()
    view = view_as_planned(looked, chosen, scene_recipe.base, cache, device, progress)
    rendered = time.perf_counter()
    fidelity = chosen.fidelity
    if bands is not None:  # in place of what the plan gathers them in
        view, fidelity = (
            merged_bands(view, bands),
            fidelity.changed({"band_groups": 0, "group_wavelengths": 0}),
        )
    if reference is not None:
        check_crop(view, where)
    photo = capture(view, optics, fidelity, seed=seed, device=torch_device(device))
    numbers = {
        "psnr_db.photo": psnr(photo.image, photo.ideal),
        "seconds.plan": planned - started,
        "seconds.render": rendered - planned,
        "seconds.expose": time.perf_counter() - rendered,
        **plan_figures(chosen),
        **{f"light_lost.{name}": float(value) for name, value in zip("rgb", photo.truncated, strict=False)},
        "peak_memory_mib": peak_memory_mib(),
    }
    outputs = {
        "photo (EXR, linear)": write_photo(folder / "photo.exr", photo),
        "photo (PNG, sRGB)": save_srgb(folder / "photo.png", photo.image),
        "ideal (PNG, sRGB)": save_srgb(folder / "ideal.png", photo.ideal),
    }
    lines: list[str | Table] = [
        *plan_lines(chosen),
        f"photo {numbers['psnr_db.photo']:.2f} dB against the ideal image",
    ]
    if reference is not None:
        begun = time.perf_counter()
        true = photo.exposure * reference_photo(
            reference,
            view,
            scene_recipe.recipe,
            scene_recipe.base,
            optics,
            where,
            device=device,
            progress=progress,
        )
        rows, columns = (
            slice(at, at + size) for at, size in ((where.top, where.height), (where.left, where.width))
        )
        numbers["psnr_db.against_reference"] = psnr(photo.clean[:, rows, columns].cpu(), true)
        numbers["seconds.reference"] = time.perf_counter() - begun
        numbers["peak_memory_mib"] = peak_memory_mib()
        outputs["reference (EXR, linear)"] = write_image(folder / "reference.exr", true)
        outputs["reference (PNG, sRGB)"] = save_srgb(folder / "reference.png", true)
        lines.append(
            f"there the photo without noise {numbers['psnr_db.against_reference']:.2f} dB against the "
            f"{reference} reference, which took {numbers['seconds.reference']:.0f} s"
        )
    inputs = inputs_of(scene_recipe, camera_recipe, crop=crop, reference=reference)
    return finish("expose", lines, numbers, outputs, json, inputs=inputs, seed=seed)


def _score_table(result: Any) -> Table:
    names = {"photo": "photo", "restored": f"restored ({result.restored_by})", "wiener": "Wiener instead"}
    names = {name: label for name, label in names.items() if name in result.scores}
    names["lens_alone"] = "lens alone"
    ranges = [(part.near_m, part.far_m) for part in result.by_depth["photo"]]
    table = Table("PSNR / dB (SSIM)", "whole", *(_range(near, far) for near, far in ranges), box=None)
    for name, label in names.items():
        cells = [result.scores[name], *(part.score for part in result.by_depth[name])]
        table.add_row(label, *(f"{cell.psnr_db:.2f} ({cell.ssim:.3f})" for cell in cells))
    return table


def _range(near: float, far: float) -> str:
    return f"{near:g} m to {'infinity' if math.isinf(far) else f'{far:g} m'}"
