"""What each command does: from its options to files, figures and lines to print."""

from __future__ import annotations

import json as json_text
import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rich.table import Table

from . import console
from .errors import EdofsimError, InputError
from .recipe import CameraRecipe, Loaded, SceneRecipe, load_camera, load_scene
from .recipe.load import load_train
from .record import peak_memory_mib, record, writable_folder, write_record

Progress = Callable[[float, str], None]


@dataclass(frozen=True)
class Aim:
    """What a user asks a plan for, as typed: `--accuracy` or `--time`."""

    accuracy: str | None = None
    time: str | None = None

    def target(self) -> Any:
        """As `edofsim.plan.Target`. Raises InputError for what cannot be read."""
        from .plan import parse_target

        return parse_target(self.accuracy, self.time)


@dataclass(frozen=True)
class Done:
    """The end of a command: what it prints, last of all the paths of what it wrote."""

    printed: Sequence[str | Table] = ()
    outputs: Mapping[str, Path] = field(default_factory=dict)

    def show(self) -> None:
        for item in self.printed:
            console.out.print(item, markup=False) if isinstance(item, str) else console.out.print(item)
        console.show_outputs(self.outputs)


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
    scene_recipe, camera_recipe = _recipes(scene, camera)
    folder = writable_folder(out or Path("out") / scene_recipe.recipe.name)
    from . import pipeline
    from .expose import write_photo
    from .report import save_srgb, write_run_report

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
            inputs=_inputs(scene_recipe, camera_recipe, network=network),
            outputs=outputs,
            plan=_plan_rows(result.plan),
            settings=vars(result.plan.simulation),
            restored_by=result.restored_by,
        )
        write_record(json, content)
    lines = [
        *_plan_lines(result.plan),
        _score_table(result),
        f"render {numbers['seconds.render']:.1f} s, expose {numbers['seconds.expose']:.1f} s, "
        f"in all {numbers['seconds.total']:.1f} s; peak memory {numbers['peak_memory_mib']:.0f} MiB",
    ]
    return Done(lines, outputs)


def _cost_of(result: Any, folder: Path, progress: Progress) -> list[Any]:
    """What accuracy costs for the photo of a run, measured in its folder."""
    from .evaluate import cost
    from .plan import planner_of

    height = result.checkpoint.height if result.checkpoint else None
    planner = planner_of(result.view, result.optics, height=height)
    return cost.measure(
        result.view,
        result.optics,
        cost.cases_of(planner),
        folder,
        height=height,
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
    from .render.jobs import MANIFEST, Task, forecast, render_many, render_one
    from .scene.family import members as family_members

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
    from .render import cache as store

    outputs = {"manifest": (cache or store.default_folder()) / MANIFEST} if fresh else {}
    if folder:
        outputs |= _view_pictures(tasks, folder, target, cache)
    numbers["peak_memory_mib"] = peak_memory_mib()
    inputs = {"scenes": [str(item.path) for item in loaded], "members": members, "noise": target}
    return _finish("render", [table], numbers, outputs, json, inputs=inputs)


def _as_planned(task: Any, aim: Aim, cache: Path | None, device: str, progress: Progress) -> Any:
    """A task without what the photo through the scene's own camera does not call for."""
    from .optics import Camera
    from .plan import look, plan_scene, simpler_recipe
    from .render.jobs import Task

    target = aim.target()
    camera = load_camera(task.recipe.camera, task.base)
    optics = Camera.from_recipe(camera.recipe, camera.base)
    looked = look(task.recipe, task.base, optics, cache=cache, device=device, progress=progress)
    plan = plan_scene(looked, optics, target=target, progress=progress)
    console.err.print(f"{task.recipe.name}: planned for {plan.target}", markup=False)
    return Task(simpler_recipe(task.recipe, plan.simulation), task.base)


def _view_pictures(
    tasks: Sequence[Any], folder: Path, noise: float | None, cache: Path | None
) -> dict[str, Path]:
    from .expose import ideal_image
    from .render import cached
    from .report import depth_plot, save_srgb

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
    from .evaluate.scores import psnr
    from .expose import write_image, write_photo
    from .expose.bands import merged_bands
    from .optics import Camera
    from .pipeline import plan_figures, torch_device, view_as_planned
    from .plan import look, photograph, plan_scene
    from .reference import check_crop, check_reference, crop_of, reference_photo
    from .report import save_srgb

    target = aim.target()
    if (reference is None) != (crop is None):
        raise InputError("--reference and --crop X,Y,WIDTH,HEIGHT belong together: a reference is slow")
    scene_recipe, camera_recipe = _recipes(scene, camera)
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
    simulation = chosen.simulation
    if bands is not None:  # in place of what the plan gathers them in
        view, simulation = merged_bands(view, bands), simulation.changed({"groups": 0, "colours": 0})
    if reference is not None:
        check_crop(view, where)
    photo = photograph(view, optics, simulation, seed=seed, device=torch_device(device))
    numbers = {
        "psnr_db.photo": psnr(photo.image, photo.ideal),
        "seconds.plan": planned - started,
        "seconds.render": rendered - planned,
        "seconds.expose": time.perf_counter() - rendered,
        **plan_figures(chosen),
        **{f"light_lost.{name}": float(value) for name, value in zip("rgb", photo.lost, strict=False)},
        "peak_memory_mib": peak_memory_mib(),
    }
    outputs = {
        "photo (EXR, linear)": write_photo(folder / "photo.exr", photo),
        "photo (PNG, sRGB)": save_srgb(folder / "photo.png", photo.image),
        "ideal (PNG, sRGB)": save_srgb(folder / "ideal.png", photo.ideal),
    }
    lines: list[str | Table] = [
        *_plan_lines(chosen),
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
    inputs = _inputs(scene_recipe, camera_recipe, crop=crop, reference=reference)
    return _finish("expose", lines, numbers, outputs, json, inputs=inputs, seed=seed)


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
    scene_recipe, camera_recipe = _recipes(scene, camera)
    from .optics import Camera
    from .pipeline import plan_figures
    from .plan import look, plan_scene

    optics = Camera.from_recipe(camera_recipe.recipe, camera_recipe.base)
    looked = look(
        scene_recipe.recipe, scene_recipe.base, optics, cache=cache, device=device, progress=progress
    )
    chosen = plan_scene(looked, optics, overrule=overrule, target=target, progress=progress)
    inputs = _inputs(scene_recipe, camera_recipe)
    numbers = plan_figures(chosen)
    return _finish("plan", _plan_lines(chosen), numbers, {}, json, inputs=inputs, plan=_plan_rows(chosen))


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
    scene_recipe, camera_recipe = _recipes(scene, camera)
    folder = writable_folder(out or Path("out") / f"cost-{scene_recipe.recipe.name}")
    from .evaluate import cost
    from .optics import Camera
    from .pipeline import torch_device
    from .plan import planner_of
    from .render import render
    from .report.cost_chart import cost_plot

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
        progress=progress,
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
    numbers = {**cost.figures(rows), "times_faster.chosen": saved}
    outputs = {
        "table": cost.write_table(folder / "cost.csv", rows),
        "chart": cost_plot(rows, scene_recipe.recipe.name).save(folder / "cost.png"),
    }
    lines = [table, f"the default choice is {saved:.1f} times as fast as the full simulation"]
    return _finish("cost", lines, numbers, outputs, json, inputs=_inputs(scene_recipe, camera_recipe))


def restore_file(
    photo: Path,
    camera: str,
    network: str | None,
    near_m: float,
    far_m: float,
    out: Path | None,
    json: Path | None,
) -> Done:
    """`edofsim restore`."""
    if not 0 < near_m <= far_m:
        raise InputError(f"--near {near_m:g} and --far {far_m:g}: give 0 < near <= far, in metres")
    loaded = load_camera(camera)
    folder = writable_folder(out or Path("out") / f"{photo.stem}-restored")
    import torch

    from .expose import read_image, write_image
    from .optics import Camera
    from .pipeline import choose_network, depths_between
    from .recipe.scene import Bands
    from .report import save_srgb
    from .restore import restore

    checkpoint, recipe = choose_network(network, loaded)
    image = read_image(photo)
    optics = Camera.from_recipe(recipe, loaded.base)
    wavelengths = torch.from_numpy(Bands().wavelengths())
    depths = depths_between(torch.tensor(1 / far_m), torch.tensor(1 / near_m))
    started = time.perf_counter()
    restored, by = restore(image, optics, wavelengths, depths, checkpoint=checkpoint)
    numbers = {"seconds.restore": time.perf_counter() - started, "peak_memory_mib": peak_memory_mib()}
    outputs = {
        "restored (EXR, linear)": write_image(folder / "restored.exr", restored),
        "restored (PNG, sRGB)": save_srgb(folder / "restored.png", restored),
    }
    lines = [f"{by}: {numbers['seconds.restore']:.2f} s"]
    inputs = {"photo": str(photo), "camera": camera, "network": network}
    return _finish("restore", lines, numbers, outputs, json, inputs=inputs)


def train_recipe(
    recipe: str,
    data: Path | None,
    resume: bool,
    max_minutes: float | None,
    out: Path | None,
    json: Path | None,
    cache: Path | None,
    device: str,
    progress: Progress,
) -> Done:
    """`edofsim train`."""
    loaded = load_train(recipe)
    folder = writable_folder(out or Path("out") / f"train-{loaded.path.stem}")
    from .learn import train

    trained = train(
        loaded,
        folder,
        data=data,
        resume=resume,
        max_minutes=max_minutes,
        device=device,
        cache=cache,
        progress=progress,
    )
    lines = [f"{name} {value:.6g}" for name, value in trained.figures.items()]
    if not trained.finished:
        lines.append(f"not finished: go on with edofsim train {recipe} --resume --out {folder}")
    outputs = {path.name: path for path in trained.outputs}
    inputs = {"recipe": str(loaded.path), "data": str(data) if data else None}
    return _finish("train", lines, trained.figures, outputs, json, inputs=inputs)


def evaluate_table(
    data: Path,
    systems: Sequence[str] | None,
    limit: int | None,
    seed: int,
    out: Path | None,
    json: Path | None,
    progress: Progress,
) -> Done:
    """`edofsim evaluate table`."""
    folder = writable_folder(out or Path("out") / "table")
    from .evaluate import table

    numbers = table.run(folder, data, systems=systems or None, seed=seed, limit=limit, progress=progress)
    return _experiment("evaluate table", numbers, folder, json, {"data": str(data), "seed": seed})


def draw_psf(camera: str, out: Path | None, json: Path | None) -> Done:
    """`edofsim psf`."""
    loaded = load_camera(camera)
    from .evaluate import psf_figure
    from .optics import Camera

    folder = writable_folder(out or Path("out") / f"psf-{loaded.recipe.name}")
    numbers = psf_figure.run(Camera.from_recipe(loaded.recipe, loaded.base), folder)
    return _experiment("psf", numbers, folder, json, {"camera": camera})


def draw_masks(out: Path | None, json: Path | None) -> Done:
    """`edofsim psf --masks`."""
    from .evaluate import psf_figure

    folder = writable_folder(out or Path("out") / "masks")
    picture = psf_figure.gallery(folder)
    return _finish("psf --masks", [], {}, {"masks": picture}, json)


def evaluate_mtf(camera: str | None, out: Path | None, json: Path | None) -> Done:
    """`edofsim evaluate mtf`."""
    loaded = load_camera(camera or "paper-cubic")
    from .evaluate import mtf
    from .optics import Camera

    folder = writable_folder(out or Path("out") / "mtf")
    return _experiment(
        "evaluate mtf",
        mtf.run(folder, Camera.from_recipe(loaded.recipe, loaded.base)),
        folder,
        json,
        {"camera": loaded.recipe.name},
    )


def evaluate_bandwidth(out: Path | None, json: Path | None) -> Done:
    """`edofsim evaluate bandwidth`."""
    from .evaluate import bandwidth

    folder = writable_folder(out or Path("out") / "bandwidth")
    return _experiment("evaluate bandwidth", bandwidth.run(folder), folder, json, {})


def evaluate_predictions(
    scenes: Sequence[str],
    quick: bool,
    out: Path | None,
    json: Path | None,
    cache: Path | None,
    progress: Progress,
) -> Done:
    """`edofsim evaluate predictions`."""
    from .evaluate import predictions

    folder = writable_folder(out or Path("out") / ("predictions-quick" if quick else "predictions"))
    outcomes = predictions.run(
        folder, scenes=scenes or predictions.SCENES, quick=quick, cache=cache, progress=progress
    )
    table = Table("scene", "mask", "case", "PSNR / dB", "predicted", "seconds", "predicted", box=None)
    for outcome in outcomes:
        for row in outcome.rows:
            if row.case.kind in ("without", "target") and row.measured_db < predictions.MATTERS_DB:
                table.add_row(
                    outcome.scene,
                    outcome.mask,
                    f"{row.case.kind} {row.case.name}",
                    f"{row.measured_db:.1f}",
                    f"{row.case.predicted_db:.1f}",
                    f"{row.seconds:.2f}",
                    f"{row.case.predicted_seconds:.2f}",
                )
    numbers = predictions.figures(outcomes)
    numbers |= {f"times_faster.{name}": value for name, value in predictions.saved(outcomes).items()}
    totals = Table("figure", "value", box=None)
    for name, value in numbers.items():
        totals.add_row(name, f"{value:.4g}")
    return _finish("evaluate predictions", [table, totals], numbers, {"measurements": folder}, json)


def evaluate_occlusion(
    scenes: Sequence[str],
    out: Path | None,
    json: Path | None,
    cache: Path | None,
    device: str,
    progress: Progress,
) -> Done:
    """`edofsim evaluate occlusion`."""
    folder = writable_folder(out or Path("out") / "occlusion")
    from .evaluate import occlusion

    chosen = tuple(scenes) or occlusion.SCENES
    for scene in chosen:
        load_scene(scene)  # a wrong name is refused before any time is spent
    numbers = occlusion.run(folder, chosen, cache=cache, device=device, progress=progress)
    table = Table("scene", "mask", "focus", *(f"{way} / dB" for way in occlusion.OCCLUSIONS), box=None)
    for row in occlusion.table(numbers):
        table.add_row(*(f"{cell:.2f}" if isinstance(cell, float) else cell for cell in row))
    names = [*(f"occlusion-{scene}.png" for scene in chosen), "occlusion.csv"]
    outputs = {name: folder / name for name in names}
    return _finish("evaluate occlusion", [table], numbers, outputs, json, inputs={"scenes": list(chosen)})


def evaluate_stability(names: Sequence[str], out: Path | None, json: Path | None, progress: Progress) -> Done:
    """`edofsim evaluate stability`."""
    from .evaluate import stability
    from .report.stability_page import stability_page, write_page

    stability.choose(names)  # a wrong name is told before any time is spent
    folder = writable_folder(out or Path("out") / "stability")
    results = stability.run(names, progress)
    numbers = stability.figures(results)
    table = Table("case", "group", "ways", "holds", "nearest to its bound", "error", "bound", box=None)
    for result in results:
        worst = result.worst
        cells = ("", "", "") if worst is None else (worst.way, f"{worst.error:.2g}", f"{worst.bound:.2g}")
        holds = result.failed or ("yes" if result.holds else "NO")
        table.add_row(result.case.name, result.case.group, str(len(result.findings)), holds, *cells)
    summary = (
        f"{numbers['cases']:.0f} cases, {numbers['findings']:.0f} findings in {numbers['seconds']:.0f} s: "
        f"{numbers['beyond_bound']:.0f} beyond their bound, {numbers['failed']:.0f} cases without an end; "
        f"float32 photos differ from float64 by at most {numbers['single_precision']:.1g} of their brightest "
        "value"
    )
    outputs = {
        "findings": stability.write_csv(folder / "stability.csv", results),
        "page": write_page(folder / "stability.html", stability_page(results, numbers)),
    }
    return _finish(
        "evaluate stability", [table, summary], numbers, outputs, json, inputs={"cases": list(names)}
    )


def evaluate_bench(names: Sequence[str], out: Path | None, json: Path | None, progress: Progress) -> Done:
    """`edofsim evaluate bench`."""
    from .evaluate import benches
    from .record import machine

    folder = writable_folder(out or Path("out") / "bench")
    numbers = benches.run(names or benches.BENCHES, progress, folder)
    table = Table("figure", "value", box=None)
    for name, value in numbers.items():
        table.add_row(name, f"{value:.4g}")
    about = machine()
    line = f"{about['processor']}, {about['cores']} cores, {about['memory_gib']} GiB, {about['system']}"
    outputs = {path.stem: path for path in sorted(folder.glob("*.png"))}
    inputs = {"benchmarks": list(names)}
    return _finish("evaluate bench", [table, line], numbers, outputs, json, inputs=inputs)


def cache_list(cache: Path | None, json: Path | None) -> Done:
    """`edofsim cache ls`."""
    from .render import cache as store

    folder = cache or store.default_folder()
    entries = store.ls(folder)
    table = Table("key", "scene", "MiB", "last used", box=None)
    for entry in entries:
        used = time.strftime("%Y-%m-%d %H:%M", time.localtime(entry.used))
        table.add_row(entry.key[:16], entry.scene, f"{entry.bytes / 2**20:.1f}", used)
    numbers = {"entries": len(entries), "size_mib": sum(entry.bytes for entry in entries) / 2**20}
    lines = [table, f"{len(entries)} views, {numbers['size_mib']:.1f} MiB"]
    return _finish("cache ls", lines, numbers, {"cache": folder}, json)


def cache_check(cache: Path | None, json: Path | None) -> Done:
    """`edofsim cache verify`."""
    from .render import cache as store

    folder = cache or store.default_folder()
    checked = store.verify(folder)
    lines = [
        f"{path.name}: damaged, set aside; it is rendered again when it is asked for"
        for path in checked.damaged
    ]
    lines.append(f"{checked.good} views are as they were written, {len(checked.damaged)} were damaged")
    numbers = {"good": checked.good, "damaged": len(checked.damaged)}
    return _finish("cache verify", lines, numbers, {"cache": folder}, json)


def cache_clear(cache: Path | None, older_than_days: float, json: Path | None) -> Done:
    """`edofsim cache prune`."""
    from .render import cache as store

    folder = cache or store.default_folder()
    removed = store.prune(folder, older_than_days)
    numbers = {"removed": removed.files, "freed_mib": removed.bytes / 2**20}
    return _finish(
        "cache prune",
        [f"{removed.files} files removed, {numbers['freed_mib']:.1f} MiB"],
        numbers,
        {"cache": folder},
        json,
    )


def examine_engines(again: bool, json: Path | None) -> Done:
    """`edofsim doctor`."""
    from .render import engine

    probes = engine.find_engines(again=again)
    chosen = engine.choose(probes)  # raises EngineError with the command to type
    table = Table("engine", "version", "library", "works", "used", box=None)
    for probe in probes:
        works = "yes" if probe.works else f"no: {probe.reason}"
        table.add_row(probe.variant, probe.version, probe.library, works, "*" if probe == chosen else "")
    numbers = {"engines.found": len(probes), "engines.working": sum(probe.works for probe in probes)}
    return _finish("doctor", [table, engine.hint(probes, chosen)], numbers, {}, json)


def recipe_schema(kind: str, out: Path | None) -> None:
    """`edofsim schema`."""
    from .recipe.schema import json_schema, model_of, write_schema

    model = model_of(kind)
    if out is None:
        console.out.print(
            json_text.dumps(json_schema(model, f"edofsim {kind} recipe"), indent=1, sort_keys=True),
            markup=False,
        )
    else:
        writable_folder(out.parent)
        console.show_outputs({"schema": write_schema(model, f"edofsim {kind} recipe", out)})


def _recipes(scene: str, camera: str | None) -> tuple[Loaded[SceneRecipe], Loaded[CameraRecipe]]:
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


def _inputs(scene: Loaded[SceneRecipe], camera: Loaded[CameraRecipe], **more: Any) -> dict[str, Any]:
    return {"scene": str(scene.path), "camera": str(camera.path)} | {
        k: str(v) for k, v in more.items() if v is not None
    }


def _finish(
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


def _experiment(
    command: str, numbers: Mapping[str, float], folder: Path, json: Path | None, inputs: dict[str, Any]
) -> Done:
    table = Table("figure", "value", box=None)
    for name, value in numbers.items():
        table.add_row(name, f"{value:.6g}")
    outputs = {path.name: path for path in sorted(folder.iterdir()) if path.is_file()}
    return _finish(command, [table], numbers, outputs, json, inputs=inputs)


def _plan_rows(plan: Any) -> list[dict[str, Any]]:
    return [vars(decision) for decision in plan.decisions]


def _plan_lines(plan: Any) -> list[str | Table]:
    """The plan's table, and what it comes to as a whole."""
    from .plan import decibels, overall

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
