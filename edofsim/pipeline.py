"""The main job on one page: render, plan, expose, restore, score, report."""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import torch
from torch import Tensor

from .capture import Photo
from .errors import InputError
from .optics import Camera
from .plan import Looked, Plan, Target, decibels, look, overall, photograph, plan_scene, simpler_recipe
from .recipe import CameraRecipe, Loaded, SceneRecipe
from .record import peak_memory_mib
from .render import View, render
from .restore import restore
from .restore.checkpoint import Checkpoint, camera_with_mask, load_checkpoint, network_of
from .restore.scores import DepthScore, Score, score, score_by_depth, within_scale

Progress = Callable[[float, str], None]

WIENER = "wiener"
"""In place of a checkpoint: Wiener deconvolution, whatever the camera."""


@dataclass(frozen=True)
class Run:
    """All that the main job made. Images are linear [channel, y, x], full scale 1; wiener: the photo restored
    by Wiener deconvolution, for comparison where a network restored."""

    scene: Loaded[SceneRecipe]
    camera: Loaded[CameraRecipe]
    optics: Camera
    checkpoint: Checkpoint | None
    seed: int
    view: View
    plan: Plan
    photo: Photo
    restored: Tensor
    restored_by: str
    wiener: Tensor | None
    lens_alone: Photo
    scores: Mapping[str, Score]
    by_depth: Mapping[str, tuple[DepthScore, ...]]
    seconds: Mapping[str, float]
    peak_memory_mib: float


@dataclass
class Stopwatch:
    """Seconds of each stage, by name."""

    seconds: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def stage(self, name: str, progress: Progress | None, fraction: float) -> Generator[None]:
        if progress:
            progress(fraction, name)
        start = time.perf_counter()
        yield
        self.seconds[name] = time.perf_counter() - start


def run(
    scene: Loaded[SceneRecipe],
    camera: Loaded[CameraRecipe],
    *,
    cache: Path | None = None,
    network: str | Path | None = None,
    overrule: Mapping[str, object] | None = None,
    target: Target | None = None,
    seed: int = 0,
    device: str = "auto",
    progress: Progress | None = None,
) -> Run:
    """Photograph a scene, restore the photo, and score both.

    cache: folder of rendered views, None for the default one. network: checkpoint (file or shipped name)
    that restores, and whose DOE the camera then has; `wiener` for Wiener deconvolution; None for the network
    that was trained with the camera's mask, or Wiener deconvolution where there is none. overrule: what
    replaces the plan's choices (see `plan_photo`). target: the accuracy or time that is planned for. seed: of
    the sensor's noise. device: auto, cpu or cuda.
    Raises InputError for what cannot be used, EngineError where nothing can render.
    """
    watch = Stopwatch()
    compute = torch_device(device)
    checkpoint, optics = choose_network(network, camera)
    alone = optics.without_mask()
    with watch.stage("plan", progress, 0.0):
        looked = look(scene.recipe, scene.base, optics, cache=cache, device=device)
        plan = plan_scene(
            looked, optics, overrule=overrule, target=target, progress=_part(progress, 0.0, 0.2)
        )
    with watch.stage("render", progress, 0.2):
        view = view_as_planned(looked, plan, scene.base, cache, device, _part(progress, 0.2, 0.7))
    with watch.stage("expose", progress, 0.72):
        photo = photograph(view, optics, plan.fidelity, seed=seed, device=compute)
    with watch.stage("lens alone", progress, 0.82):
        lens_alone = photograph(
            view, alone, plan.fidelity, seed=seed, device=compute, exposure=photo.exposure
        )
    with watch.stage("restore", progress, 0.92):
        depths = depths_between(view.inverse_depth.min(), view.inverse_depth.max())
        restored, by = restore(photo.image, optics, view.wavelengths, depths, checkpoint=checkpoint)
    wiener = None
    if checkpoint is not None:
        with watch.stage("wiener", progress, 0.94):
            wiener, _ = restore(photo.image, optics, view.wavelengths, depths)
    with watch.stage("score", progress, 0.96):
        inverse_depth = view.crop_margin(view.mean_inverse_depth())
        images = {
            "photo": photo.image,
            "restored": restored,
            "wiener": wiener,
            "lens_alone": lens_alone.image,
        }
        images = {name: within_scale(image) for name, image in images.items() if image is not None}
        truth = within_scale(photo.ideal)
        scores = {name: score(image, truth) for name, image in images.items()}
        by_depth = {name: score_by_depth(image, truth, inverse_depth) for name, image in images.items()}
    return Run(
        scene=scene,
        camera=camera,
        optics=optics,
        checkpoint=checkpoint,
        seed=seed,
        view=view,
        plan=plan,
        photo=photo,
        restored=restored,
        restored_by=by,
        wiener=wiener,
        lens_alone=lens_alone,
        scores=scores,
        by_depth=by_depth,
        seconds=watch.seconds,
        peak_memory_mib=peak_memory_mib(),
    )


def choose_network(
    network: str | Path | None, camera: Loaded[CameraRecipe]
) -> tuple[Checkpoint | None, Camera]:
    """What restores (None: Wiener deconvolution), and the camera with the mask that it was trained with.

    network: see `run`. Raises InputError for a checkpoint that is damaged or of another camera.
    """
    if network == WIENER:
        return None, Camera.from_recipe(camera.recipe, camera.base)
    checkpoint = network_of(camera) if network is None else load_checkpoint(network, camera.recipe)
    if checkpoint is None:
        return None, Camera.from_recipe(camera.recipe, camera.base)
    return checkpoint, camera_with_mask(camera.recipe, checkpoint, camera.base)


def figures(result: Run) -> dict[str, float]:
    """The figures of `--json`, flat: what, of which image, where."""
    found: dict[str, float] = {}
    for name, whole in result.scores.items():
        found[f"psnr_db.{name}"] = whole.psnr_db
        found[f"ssim.{name}"] = whole.ssim
        for part in result.by_depth[name]:
            found[f"psnr_db.{name}.{part.near_m:g}m_to_{part.far_m:g}m"] = part.score.psnr_db
            found[f"ssim.{name}.{part.near_m:g}m_to_{part.far_m:g}m"] = part.score.ssim
    found |= {f"seconds.{stage.replace(' ', '_')}": seconds for stage, seconds in result.seconds.items()}
    found["seconds.total"] = sum(result.seconds.values())
    found["peak_memory_mib"] = result.peak_memory_mib
    found["render_noise"] = result.view.noise
    found |= plan_figures(result.plan)
    return found


def view_as_planned(
    looked: Looked, plan: Plan, base: Path, cache: Path | None, device: str, progress: Progress | None
) -> View:
    """The view that a plan was made on, or a rendering with what the plan leaves out left out."""
    if looked.facts.final:
        return looked.facts.view
    planned = simpler_recipe(looked.recipe, plan.fidelity)
    return render(planned, base, cache=cache, device=device, progress=progress)


def plan_figures(plan: Plan) -> dict[str, float]:
    """What a plan predicts, flat."""
    found: dict[str, float] = {"plan.psnr_db": plan.error_db, "plan.memory_mib": plan.memory_mib}
    found["plan.seconds"] = sum(plan.seconds.values())
    found |= {f"plan.seconds.{stage}": value for stage, value in plan.seconds.items()}
    for decision in plan.decisions:
        name = decision.effect.replace(" ", "_")
        found[f"called_for.{name}"] = int(decision.called_for)
        if decision.error is not None:
            found[f"psnr_db.without_{name}"] = decibels(overall(decision.error))
            found[f"plan.seconds.{name}"] = decision.seconds
    return found


def depths_between(far: Tensor, near: Tensor, count: int = 9) -> Tensor:
    """Inverse depths that stand for a scene, equally spaced over what it spans, [depth]."""
    return torch.linspace(float(far), float(near), 1 if far == near else count)


def torch_device(device: str) -> str:
    """The torch device for `auto`, `cpu` or `cuda`. Raises InputError for CUDA where there is none."""
    if device == "cuda" and not torch.cuda.is_available():
        raise InputError("--device cuda: PyTorch finds no CUDA device here; use --device cpu or auto")
    return ("cuda" if torch.cuda.is_available() else "cpu") if device == "auto" else device


def _part(progress: Progress | None, start: float, end: float) -> Progress | None:
    """Progress of a stage as progress of the whole."""
    return None if progress is None else lambda done, text: progress(start + done * (end - start), text)
