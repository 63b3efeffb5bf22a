"""The main job on one page: render, plan, expose, restore, score, report."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from .errors import InputError
from .evaluate.scores import DepthScore, Score, score, score_by_depth
from .expose import Photo, expose
from .optics import Camera
from .plan import Plan, plan_photo
from .recipe import CameraRecipe, Loaded, SceneRecipe
from .record import peak_memory_mib
from .render import View, render
from .restore import restore
from .restore.checkpoint import Checkpoint, load_checkpoint

Progress = Callable[[float, str], None]


@dataclass(frozen=True)
class Run:
    """All that the main job made. Images are linear [channel, y, x], full scale 1."""

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
    def stage(self, name: str, progress: Progress | None, fraction: float) -> Iterator[None]:
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
    overrule: Mapping[str, Any] | None = None,
    seed: int = 0,
    device: str = "auto",
    progress: Progress | None = None,
) -> Run:
    """Photograph a scene, restore the photo, and score both.

    cache: folder of rendered views, None for the default one. network: checkpoint (file or shipped name)
    that restores, and whose DOE the camera then has; None for Wiener deconvolution. overrule: settings of
    `expose` that replace the plan's. seed: of the sensor's noise. device: auto, cpu or cuda.
    Raises InputError for what cannot be used, EngineError where nothing can render.
    """
    watch = Stopwatch()
    compute = torch_device(device)
    optics = Camera.from_recipe(camera.recipe, camera.base)
    checkpoint = None if network is None else load_checkpoint(network, camera.recipe)
    height = None if checkpoint is None else checkpoint.height
    alone = optics.without_mask()
    with watch.stage("render", progress, 0.0):
        view = render(
            scene.recipe, scene.base, cache=cache, device=device, progress=_part(progress, 0.0, 0.7)
        )
    with watch.stage("plan", progress, 0.7):
        plan = plan_photo(view, optics, overrule)
    with watch.stage("expose", progress, 0.72):
        photo = expose(view, optics, height=height, seed=seed, device=compute, **plan.settings)
    with watch.stage("lens alone", progress, 0.82):
        lens_alone = expose(view, alone, seed=seed, device=compute, exposure=photo.exposure, **plan.settings)
    with watch.stage("restore", progress, 0.92):
        depths = depths_between(view.inverse_depth.min(), view.inverse_depth.max())
        restored, by = restore(photo.image, optics, view.wavelengths, depths, checkpoint=checkpoint)
    with watch.stage("score", progress, 0.96):
        inverse_depth = view.crop_margin(view.mean_inverse_depth())
        images = {"photo": photo.image, "restored": restored, "lens_alone": lens_alone.image}
        scores = {name: score(image, photo.ideal) for name, image in images.items()}
        by_depth = {name: score_by_depth(image, photo.ideal, inverse_depth) for name, image in images.items()}
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
        lens_alone=lens_alone,
        scores=scores,
        by_depth=by_depth,
        seconds=watch.seconds,
        peak_memory_mib=peak_memory_mib(),
    )


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
