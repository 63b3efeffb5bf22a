"""The main job on one page: render, plan, expose, restore, score, report."""

from __future__ import annotations

import time
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from torch import Tensor

from .capture import Fidelity, Photo, capture
from .capture.checks import check_fits
from .capture.device import torch_device
from .capture.fidelity import simpler_camera
from .capture.fidelity_file import WHERE, read_fidelity
from .capture.field import frame_of
from .capture.framing import framed, seen_through
from .capture.noise import PhotoNoise, photo_noise
from .capture.presets import PRESETS, preset
from .core.progress import Progress
from .core.threads import in_threads
from .optics import Camera
from .optics.nodes import nodes_between
from .plan import (
    RESTORED,
    Facts,
    Plan,
    Target,
    checked_overrule,
    facts_of,
    insisted_rendering,
    learn_rates,
    look,
    plan_alone,
    plan_figures,
    plan_photo,
    plan_scene,
    simpler_recipe,
    with_predicted,
)
from .recipe import CameraRecipe, Loaded, SceneRecipe
from .record import peak_memory_mib
from .render import cached, render
from .render.view import View
from .restore import channel_psfs, restore
from .restore.checkpoint import Checkpoint
from .restore.choice import choose_network
from .restore.gains import gain_figures, gains
from .restore.places import Method
from .restore.scores import DepthScore, Score, TruthNoise, score_by_depth
from .restore.truth import Truth, noise_figures, samples_for


@dataclass(frozen=True)
class Run:
    """All that the main job made. Images are linear [channel, y, x], full scale 1.

    wiener: the photo restored by Wiener deconvolution, for comparison where a network restored.
    psfs: `channel_psfs` of the camera as the plan simulates it, at the inverse depths `psf_depths` [depth] in
        1/m, from far to near, that stand for the scene (`nodes_between`).
    plan_lens_alone: of the photo through the lens alone.
    noise: of the photo.
    noises: what images are scored without, by the names of scores.
    gains: of the restored image in dB, see `restore.gains`.
    """

    scene: Loaded[SceneRecipe]
    camera: Loaded[CameraRecipe]
    optics: Camera
    checkpoint: Checkpoint | None
    seed: int
    view: View
    plan: Plan
    plan_lens_alone: Plan
    photo: Photo
    psfs: Tensor
    psf_depths: Tensor
    restored: Tensor
    restored_by: Method
    wiener: Tensor | None
    lens_alone: Photo
    noise: PhotoNoise
    noises: Mapping[str, TruthNoise]
    scores: Mapping[str, Score]
    by_depth: Mapping[str, tuple[DepthScore, ...]]
    gains: Mapping[str, float]
    seconds: Mapping[str, float]
    peak_memory_mib: float


@dataclass
class Stopwatch:
    """Seconds of each stage, by name.

    progress: of all stages together.
    """

    progress: Progress | None = None
    seconds: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def stage(self, name: str, begin: float, end: float) -> Generator[Progress]:
        """Time a stage that goes from one fraction of the whole to another; gives its own progress."""

        def tell(done: float, text: str) -> None:
            if self.progress:
                self.progress(begin + done * (end - begin), text)

        tell(0.0, name)
        start = time.perf_counter()
        yield tell
        self.seconds[name] = time.perf_counter() - start


def run(
    scene: Loaded[SceneRecipe],
    camera: Loaded[CameraRecipe],
    *,
    cache: Path | None = None,
    network: str | Path | None = None,
    resample: bool = False,
    overrule: Mapping[str, object] | None = None,
    target: Target | None = None,
    fidelity: str | Path | None = None,
    seed: int = 0,
    device: str = "auto",
    progress: Progress | None = None,
) -> Run:
    """Photograph a scene, restore the photo, and score both, beside a photo through the lens alone.

    Either photo has a plan of its own: what a mask evens out, the bare lens may show, and nothing is restored
    from its photo (see `plan_alone`).

    cache: folder of rendered views, None for the default one.
    network: see `choose_network`.
    resample: the view, where the scene's pixels see another angle than the camera's (see `framed`).
    overrule: what replaces the plan's choices (see `plan_photo`).
    target: the accuracy or time that is planned for, None for one that keeps the restored image's PSNR
        (`RESTORED`).
    fidelity: a preset or a file that says what is simulated, in place of a plan.
    seed: of the sensor's noise.
    device: auto, cpu or cuda.

    Raises InputError for what cannot be used, EngineError where nothing can render.
    """
    watch = Stopwatch(progress)
    compute = torch_device(device)
    overrule, target = checked_overrule(overrule), target or RESTORED
    checkpoint, optics = choose_network(network, camera)
    alone = optics.without_mask()
    bare = not optics.mask_given and optics.recipe == alone.recipe
    view, plan, facts = planned_view(
        scene,
        optics,
        watch,
        resample=resample,
        overrule=overrule,
        target=target,
        fidelity=fidelity,
        cache=cache,
        device=device,
    )
    with watch.stage("plan lens alone", 0.68, 0.7) as tell:
        rival = (
            plan
            if bare
            else _alone_as(plan.replayed, view, alone)
            if plan.replayed
            else plan_alone(plan, facts, alone, overrule, target, progress=tell)
        )
    taken, taken_alone = plan.fidelity.of_photo(), rival.fidelity.of_photo()
    with watch.stage("expose", 0.7, 0.82):
        photo = with_predicted(capture(view, optics, taken, seed=seed, device=compute), plan)
    if compute == "cpu":
        learn_rates(plan.seconds, photo.seconds)
    with watch.stage("lens alone", 0.82, 0.92):
        lens_alone = (
            photo
            if bare
            else capture(view, alone, taken_alone, seed=seed, device=compute, exposure=photo.exposure)
        )
    with watch.stage("psfs", 0.92, 0.93):
        simpler = simpler_camera(optics, taken)
        depths = nodes_between(simpler, view.wavelengths, *view.inverse_depth.aminmax())
        psfs = channel_psfs(simpler, view.wavelengths, depths)

    def by_network(image: Tensor) -> tuple[Tensor, Method]:
        how = {
            "checkpoint": checkpoint,
            "psfs": psfs,
            "truncated": photo.truncated,
            "frame": frame_of([view]),
        }
        return restore(image, optics, view.wavelengths, depths, **how)

    def by_wiener(image: Tensor) -> Tensor:
        return restore(image, optics, view.wavelengths, depths, psfs=psfs, frame=frame_of([view]))[0]

    with watch.stage("restore", 0.93, 0.94):
        restored, by = by_network(photo.image)
    wiener = None
    if checkpoint is not None:
        with watch.stage("wiener", 0.94, 0.96):
            wiener = by_wiener(photo.image)
    with watch.stage("score", 0.96, 0.98):
        truth = Truth(photo.ideal, photo_noise(view, optics, taken, photo, compute))
        noise_alone = truth.noise
        if not bare:
            noise_alone = photo_noise(view, alone, taken_alone, lens_alone, compute)
        images = {"photo": (photo.image, truth.noise.image)}
        images["restored"] = restored, truth.restored_noise(photo.image, restored, lambda x: by_network(x)[0])
        if wiener is not None:
            images["wiener"] = wiener, truth.restored_noise(photo.image, wiener, by_wiener)
        images["lens_alone"] = lens_alone.image, noise_alone.image
        scores, by_depth, noises = _scored(images, truth, view)
    return Run(
        scene=scene,
        camera=camera,
        optics=optics,
        checkpoint=checkpoint,
        seed=seed,
        view=view,
        plan=plan,
        plan_lens_alone=rival,
        photo=photo,
        psfs=psfs,
        psf_depths=depths,
        restored=restored,
        restored_by=by,
        wiener=wiener,
        lens_alone=lens_alone,
        noise=truth.noise,
        noises=noises,
        scores=scores,
        by_depth=by_depth,
        gains=gains({name: whole.psnr_db for name, whole in scores.items()}),
        seconds=watch.seconds,
        peak_memory_mib=peak_memory_mib(),
    )


def _scored(
    images: Mapping[str, tuple[Tensor, Tensor | None]], truth: Truth, view: View
) -> tuple[dict[str, Score], dict[str, tuple[DepthScore, ...]], dict[str, TruthNoise]]:
    """Scores of images with their noise, as wholes and by depth, and what they are without, each by name."""
    inverse_depth = view.crop_margin(view.mean_inverse_depth())
    compared = {name: truth.compared(*pair) for name, pair in images.items()}

    def judged(each: tuple[Tensor, Tensor, TruthNoise]) -> tuple[Score, tuple[DepthScore, ...]]:
        return score_by_depth(*each, inverse_depth)

    found = in_threads(judged, list(compared.values()), truth.ideal.device)
    scores = {name: whole for name, (whole, _) in zip(images, found, strict=True)}
    by_depth = {name: parts for name, (_, parts) in zip(images, found, strict=True)}
    return scores, by_depth, {name: noise for name, (_, _, noise) in compared.items()}


def planned_view(
    scene: Loaded[SceneRecipe],
    camera: Camera,
    watch: Stopwatch,
    *,
    resample: bool = False,
    overrule: Mapping[str, object] | None = None,
    target: Target | None = None,
    fidelity: str | Path | None = None,
    cache: Path | None = None,
    device: str = "auto",
) -> tuple[View, Plan, Facts]:
    """The stages `render` and `plan`: the view of a scene, the plan of its photo, and the facts that it was
    planned on. See `run`.

    The view is rendered as its recipe says, as it is also the truth that photos are scored against, but for
    effects of rendering that the user leaves out; the photo is planned on it. Only where a time is asked for,
    rendering is planned as well, on a preview (stage `preview`), unless the view is in the cache: what can be
    done in a time depends on the machine.
    """
    overrule, recipe = checked_overrule(overrule), framed(scene.recipe, camera, resample)
    if fidelity is not None:
        how = {"cache": cache, "device": device}
        return _replayed_view(str(fidelity), recipe, scene.base, camera, watch, **how)
    rendered = recipe.source is None or recipe.source.rendered
    timed = target is not None and target.kind == "time"
    if rendered:
        recipe = simpler_recipe(recipe, insisted_rendering(overrule))
    if rendered and timed and cached(recipe, scene.base, cache=cache) is None:
        with watch.stage("preview", 0.0, 0.1) as tell:
            looked = look(recipe, scene.base, camera, cache=cache, device=device)
            plan = plan_scene(looked, camera, overrule=overrule, target=target, progress=tell)
        recipe = simpler_recipe(recipe, plan.fidelity)
    with watch.stage("render", 0.1, 0.6) as tell:
        view = render(recipe, scene.base, cache=cache, device=device, progress=tell)
        seen, view = seen_through(camera, recipe, view)
    with watch.stage("plan", 0.6, 0.68) as tell:
        left = target
        if target is not None and target.kind == "time":
            left = replace(target, spent=sum(watch.seconds.values()))
        facts = facts_of(view, camera, recipe=seen)
        plan = plan_photo(
            view,
            camera,
            overrule,
            left,
            every_effect=False,
            facts=facts,
            progress=tell,
        )
    return view, plan, facts


def _replayed_view(
    given: str,
    recipe: SceneRecipe,
    base: Path,
    camera: Camera,
    watch: Stopwatch,
    **how: Any,  # pyrefly: ignore[explicit-any]
) -> tuple[View, Plan, Facts]:
    """The view that a given fidelity asks for, that fidelity as a plan, and facts of the view. given: a name
    of `PRESETS`, or a file. Raises InputError for a fidelity that does not fit."""
    read = None if given in PRESETS else Fidelity.load(given)
    if read is not None:
        check_fits(read, camera, recipe)
        recipe = simpler_recipe(recipe, read)
    with watch.stage("render", 0.0, 0.6) as tell:
        view = render(recipe, base, progress=tell, **how)
        seen, view = seen_through(camera, recipe, view)
    with watch.stage("plan", 0.6, 0.68):
        chosen = read or preset(given, camera, view)
        facts = facts_of(view, camera, recipe=seen)
    return view, _as_given(chosen, given), facts


def _alone_as(given: str, view: View, alone: Camera) -> Plan:
    """The same through the lens alone: a run's file has its fidelity, others are taken for both."""
    if given in PRESETS:
        return _as_given(preset(given, alone, view), given)
    return _as_given(read_fidelity(Path(given), Fidelity, ("fidelity_lens_alone", *WHERE)), given)


def _as_given(fidelity: Fidelity, given: str) -> Plan:
    return Plan((), fidelity, replayed=given, target=f"the fidelity of {given}")


def figures(result: Run) -> dict[str, float]:
    """The figures of `--json`, flat: what, of which image, where."""
    found: dict[str, float] = {}
    for name, whole in result.scores.items():
        parts = {f".{part.near_m:g}m_to_{part.far_m:g}m": part.score for part in result.by_depth[name]}
        for where, each in {"": whole, **parts}.items():
            found[f"psnr_db.{name}{where}"], found[f"ssim.{name}{where}"] = each.psnr_db, each.ssim
            found[f"psnr_db_se.{name}{where}"], found[f"ssim_se.{name}{where}"] = (
                each.psnr_db_se,
                each.ssim_se,
            )
    found |= {f"seconds.{stage.replace(' ', '_')}": seconds for stage, seconds in result.seconds.items()}
    found["seconds.total"] = sum(result.seconds.values())
    found["peak_memory_mib"] = result.peak_memory_mib
    found["render_noise"] = result.view.noise
    found |= gain_figures(result.gains)
    found |= noise_figures(result.noise)
    if (wanted := samples_for(result.scores["restored"], result.view.metadata.get("samples", 0))) is not None:
        found["samples_for_0.05_db"] = wanted
    found |= plan_figures(result.plan, result.seconds["plan"])
    alone = plan_figures(result.plan_lens_alone, result.seconds["plan lens alone"])
    stem = "plan."
    return found | {
        f"plan_lens_alone.{name.removeprefix(stem)}": value
        for name, value in alone.items()
        if name.startswith(stem)
    }
