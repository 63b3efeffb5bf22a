"""What the stages before and after the photo cost: rendering's noise against its seconds, and how well each
network restores the photo against its seconds."""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor

from ..capture import Photo, capture
from ..capture.fidelity import simpler_camera
from ..capture.noise import PhotoNoise, photo_noise
from ..core.progress import Progress
from ..errors import InputError
from ..optics import Camera
from ..optics import cache as psf_memory
from ..optics.nodes import nodes_between
from ..plan import RESTORED, plan_photo
from ..plan.scene import passes_of
from ..recipe import CameraRecipe, Loaded, SceneRecipe
from ..record import machine, write_csv
from ..render import render
from ..render.fetch import run_of
from ..render.settings import samples_of_a_pass
from ..render.view import View
from ..restore import channel_psfs, forget, restore, usual_network
from ..restore.checkpoint import (
    Checkpoint,
    any_camera_checkpoints,
    camera_with_mask,
    load_checkpoint,
    shipped_checkpoints,
)
from ..restore.scores import level_and_error
from ..restore.truth import Truth
from .kept import Kept, key_of

FEWEST_SAMPLES = 4


@dataclass(frozen=True)
class Point:
    """One way through a stage.

    stage: `render` or `restore`.
    value: noise of a pixel relative to the mean, or PSNR against the all-in-focus image in dB.
    chosen: what `run` does by default.
    error: standard error of a PSNR by the noise of the rendering.
    """

    stage: str
    name: str
    value: float
    seconds: float
    chosen: bool = False
    error: float = 0.0

    @property
    def better(self) -> float:
        """Larger is better, whatever the stage."""
        return -self.value if self.stage == "render" else self.value


def render_points(
    recipe: SceneRecipe,
    base: Path,
    *,
    cache: Path | None = None,
    device: str = "auto",
    progress: Progress | None = None,
) -> list[Point]:
    """Renderings of a scene with more and more samples. They stay in the cache, and are not made twice; none
    for a view that is read from files."""
    if recipe.source is not None and not recipe.source.rendered:
        return []
    most = recipe.render.samples
    few = [2**k for k in range(int(math.log2(FEWEST_SAMPLES)), 20) if 2**k < most]
    points = []
    for number, samples in enumerate([*few, most]):
        if progress:
            progress(number / (len(few) + 1), f"rendering with {samples} samples")
        settings = recipe.render.model_copy(update={"samples": samples})
        variant = recipe.model_copy(update={"render": settings})
        view = render(variant, base, cache=cache, device=device)
        seconds = _render_seconds(variant, base, cache)
        if seconds:
            points.append(Point("render", f"{samples} samples", view.noise, seconds, samples == most))
    return points


def _render_seconds(recipe: SceneRecipe, base: Path, cache: Path | None) -> float:
    """Seconds that a rendering takes once its scene is loaded and its kernels are compiled: what its last
    pass took, for each. From its entry in the cache; 0 where that does not say."""
    run = run_of(recipe, base, cache)
    samples = recipe.render.samples
    last = samples - (passes_of(samples) - 1) * samples_of_a_pass(samples)
    return run["last_pass_seconds"]["all"] * samples / last if run and "last_pass_seconds" in run else 0.0


def restore_points(
    view: View,
    camera: Loaded[CameraRecipe],
    folder: Path,
    *,
    repeats: int = 3,
    device: str = "cpu",
    progress: Progress | None = None,
) -> list[Point]:
    """The photo restored by each shipped network that fits the camera, with its own mask, and by Wiener
    deconvolution with each of these masks.

    The networks take turns; the median of the repeats counts.

    folder: keeps what was measured.
    """
    own = usual_network(camera)
    default = _place(own)
    kept = Kept(folder / "restoration.jsonl")
    rivals: list[tuple[str, Checkpoint | None, Checkpoint | None]] = [("Wiener", None, None)]
    for name in (*shipped_checkpoints(), *any_camera_checkpoints()):
        try:
            checkpoint = load_checkpoint(name, camera.recipe)
        except InputError:  # of another camera
            continue
        if checkpoint.network.any_camera:
            rivals.append((name, None, checkpoint))
            continue
        rivals.append((name, checkpoint, checkpoint))
        if checkpoint.height is not None and _place(checkpoint) != default:
            rivals.append((f"Wiener, mask of {name}", checkpoint, None))
    scores: dict[str, tuple[float, float]] = {}
    photos: dict[Path | None, tuple[Camera, Camera, Photo, PhotoNoise]] = {}
    seconds: dict[str, list[float]] = {name: [] for name, _, _ in rivals}
    for turn in range(repeats):
        for number, (name, mask, network) in enumerate(rivals):
            if progress:
                progress((turn + number / len(rivals)) / repeats, f"restoring by {name}")
            key = key_of(turn=turn, name=name, about=_about(view, camera, mask), device=device)
            found = kept.get(key)
            if found is None:
                where = mask.path if mask else None
                if where not in photos:
                    photos[where] = _photo(view, camera, mask, device)
                found = _restored(view, *photos[where], network)
                kept.put(key, found)
            seconds[name].append(found["seconds"])
            scores[name] = (found["psnr_db"], found.get("psnr_db_se", math.nan))
    chosen = {name for name, _, network in rivals if network and _place(network) == default}
    chosen = chosen or {"Wiener"}
    taken = {name: statistics.median(found) for name, found in seconds.items()}
    return [
        Point("restore", name, scores[name][0], taken[name], name in chosen, scores[name][1])
        for name, _, _ in rivals
    ]


def _place(checkpoint: Checkpoint | None) -> Path | None:
    return checkpoint.path.resolve() if checkpoint and checkpoint.path else None


def _about(view: View, camera: Loaded[CameraRecipe], mask: Checkpoint | None) -> list[object]:
    return [
        camera.recipe.model_dump(mode="json"),
        float(view.radiance.double().sum()),
        [view.height, view.width],
        None if mask is None else dict(mask.card),
        machine(),
    ]


def _photo(
    view: View, camera: Loaded[CameraRecipe], mask: Checkpoint | None, device: str
) -> tuple[Camera, Camera, Photo, PhotoNoise]:
    """The photo that `run` takes, its noise, and what it is taken with: the camera, and as it is planned."""
    if mask is None:
        optics = Camera.from_recipe(camera.recipe, camera.base)
    else:
        optics = camera_with_mask(camera.recipe, mask, camera.base)
    fidelity = plan_photo(view, optics, target=RESTORED, every_effect=False).fidelity.of_photo()
    photo = capture(view, optics, fidelity, device=device)
    noise = photo_noise(view, optics, fidelity, photo, device)
    return optics, simpler_camera(optics, fidelity), photo, noise


def _restored(
    view: View,
    optics: Camera,
    planned: Camera,
    photo: Photo,
    noise: PhotoNoise,
    network: Checkpoint | None,
) -> dict[str, float]:
    ends = torch.stack(view.inverse_depth.aminmax())
    psf_memory.forget()
    forget()
    truth = Truth(photo.ideal, noise)

    def restores(image: Tensor) -> Tensor:
        """As `run` does: given the camera as it is planned."""
        depths, psfs = ends, None
        if network is None or network.network.any_camera:
            depths = nodes_between(planned, view.wavelengths, *ends)
            psfs = channel_psfs(planned, view.wavelengths, depths)
        truncated = None if network is None else photo.truncated
        how = {"checkpoint": network, "psfs": psfs, "truncated": truncated}
        return restore(image, optics, view.wavelengths, depths, **how)[0]

    started = time.perf_counter()
    restored = restores(photo.image)
    seconds = time.perf_counter() - started
    left = truth.restored_noise(photo.image, restored, restores)
    image, ideal, known = truth.compared(restored, left)
    level, error = level_and_error(image, ideal, known)
    return {"seconds": seconds, "psnr_db": level, "psnr_db_se": error}


def front(points: Sequence[Point]) -> list[Point]:
    """The points of a stage that no other beats in both time and quality, fastest first."""
    best: list[Point] = []
    for point in sorted(points, key=lambda point: (point.seconds, -point.better)):
        if not best or point.better > best[-1].better:
            best.append(point)
    return best


def figures(points: Sequence[Point]) -> dict[str, float]:
    """Flat: noise or PSNR, and seconds, of each point."""
    found: dict[str, float] = {}
    for point in points:
        name = point.name.replace(",", "").replace(" ", "_")
        what = "render_noise.render" if point.stage == "render" else "psnr_db.restore"
        found[f"{what}.{name}"] = point.value
        found[f"seconds.{point.stage}.{name}"] = point.seconds
        if point.stage == "restore":
            found[f"psnr_db_se.restore.{name}"] = point.error
    return found


def write_table(path: Path, points: Sequence[Point]) -> Path:
    """All points as CSV."""
    header = ("stage", "name", "render_noise", "psnr_db", "seconds", "chosen", "psnr_db_se")
    rows = (
        (
            point.stage,
            point.name,
            point.value if point.stage == "render" else "",
            point.value if point.stage == "restore" else "",
            point.seconds,
            int(point.chosen),
            point.error if point.stage == "restore" else "",
        )
        for point in points
    )
    return write_csv(path, header, rows)
