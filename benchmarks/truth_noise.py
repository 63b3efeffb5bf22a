"""What the rendering's own noise costs a score, and whether scores are without it, by samples a pixel.

`python -m benchmarks.truth_noise [SCENE...] [--samples N...] [--renders K] [--size WIDTH HEIGHT]
[--json FILE]` renders the middles of scenes, at their own pixels, photographs them through the scene's
camera, restores them by the camera's network, and scores them with the truth's noise (as scores were taken
before) and without. Each number of samples but the last is rendered K times, with other random numbers each.
The first render of a scene sets its plan and its exposure.

Figures: `psnr_db.SCENE.SAMPLES.{with,without}` and `ssim.*` alike, means of the renders;
`psnr_db_se.SCENE.SAMPLES.without`, the standard error of that mean, from how the renders differ where there
are several, and `psnr_db_said.SCENE.SAMPLES`, what one render says of its own, root mean square;
`noise_db.SCENE.SAMPLES` (of the ideal image), `seconds.SCENE.SAMPLES.{render,photo,noise}` (processor's, of
one).
"""

from __future__ import annotations

import argparse
import math
import shlex
import statistics
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TypeVar

import torch
from torch import Tensor

from edofsim.capture import Fidelity, capture
from edofsim.capture.noise import photo_noise
from edofsim.optics import Camera
from edofsim.optics.nodes import nodes_between
from edofsim.plan import plan_photo
from edofsim.recipe import SceneRecipe
from edofsim.recipe.load import load_camera, load_scene
from edofsim.record import record, write_record
from edofsim.render.colour import lit
from edofsim.render.rendering import render_model
from edofsim.render.settings import RenderSettings
from edofsim.render.view import View
from edofsim.restore import choose_network, restore
from edofsim.restore.checkpoint import Checkpoint
from edofsim.restore.scores import image_psnr, score
from edofsim.restore.truth import Truth
from edofsim.scene import build_scene

Made = TypeVar("Made")
SCENES = ("desk", "hallway", "foliage", "stilllife", "night")
SAMPLES = (16, 64, 256, 2048)
RENDERS = 8
MARGIN = 48


def timed(work: Callable[[], Made]) -> tuple[Made, float]:
    """What it makes, and the processor's seconds."""
    started = time.process_time()
    return work(), time.process_time() - started


def rendered(recipe: SceneRecipe, base: Path, number: int) -> View:
    """One of several renders of a scene, which differ in their random numbers alone."""
    settings = replace(RenderSettings.from_recipe(recipe), seed=recipe.seed + number)
    return View.of(lit(render_model(build_scene(recipe, base), settings), recipe, base))


def judged(
    view: View, camera: Camera, checkpoint: Checkpoint | None, fidelity: Fidelity, exposure: float | None
) -> tuple[dict[str, float], float]:
    """Figures of one render by their names, and the exposure of its photo."""
    exposed = partial(capture, view, camera, fidelity, exposure=exposure)
    photo, photographing = timed(exposed)
    depths = nodes_between(camera, view.wavelengths, *view.inverse_depth.aminmax())

    def restores(image: Tensor) -> Tensor:
        how = {"checkpoint": checkpoint, "truncated": photo.truncated}
        return restore(image, camera, view.wavelengths, depths, **how)[0]

    restored = restores(photo.image)

    def noise() -> tuple[Truth, Tensor | None]:
        truth = Truth(photo.ideal, photo_noise(view, camera, fidelity, photo))
        return truth, truth.restored_noise(photo.image, restored, restores)

    (truth, left), once_more = timed(noise)
    before, after = score(restored, photo.ideal), score(*truth.compared(restored, left))
    level = math.inf
    if truth.noise.ideal is not None:
        level = image_psnr(photo.ideal + truth.noise.ideal, photo.ideal)
    found = {"noise_db": level, "seconds.photo": photographing, "seconds.noise": once_more}
    for metric in ("psnr_db", "ssim"):
        found[f"{metric}.with"] = getattr(before, metric)
        found[f"{metric}.without"] = getattr(after, metric)
        found[f"{metric}_said"] = getattr(after, f"{metric}_se")
    return found, photo.exposure


def summed_up(rows: list[dict[str, float]], stem: str) -> dict[str, float]:
    """Figures of all renders of a scene with one number of samples."""
    found: dict[str, float] = {}
    for name in rows[0]:
        metric, _, which = name.partition(".")
        values = [row[name] for row in rows]
        if metric.endswith("_said"):
            found[f"{metric}.{stem}"] = math.sqrt(statistics.fmean(value**2 for value in values))
        else:
            found[".".join(filter(None, (metric, stem, which)))] = statistics.fmean(values)
        if which == "without":
            said = rows[0][f"{metric}_said"]
            differ = statistics.stdev(values) / math.sqrt(len(rows)) if len(rows) > 1 else said
            found[f"{metric}_se.{stem}.without"] = differ
    return found


def scored(name: str, samples: list[int], renders: int, size: tuple[int, int]) -> dict[str, float]:
    """The figures of a scene; prints a line for each number of samples."""
    scene = load_scene(name)
    frame = {"width_px": size[0], "height_px": size[1], "margin_px": MARGIN}
    checkpoint, camera = choose_network(None, load_camera(scene.recipe.camera, scene.base))
    fidelity: Fidelity | None = None
    exposure: float | None = None
    found: dict[str, float] = {}
    for count in samples:
        drawn = scene.recipe.render.model_copy(update={"samples": count})
        recipe = scene.recipe.model_copy(
            update={"render": drawn, "frame": scene.recipe.frame.model_copy(update=frame)}
        )
        rows: list[dict[str, float]] = []
        for number in range(1 if count == samples[-1] else renders):
            view, rendering = timed(partial(rendered, recipe, scene.base, number))
            fidelity = fidelity or plan_photo(view, camera, every_effect=False).fidelity
            row, exposure = judged(view, camera, checkpoint, fidelity, exposure)
            rows.append(row | {"seconds.render": rendering})
        stem = f"{name}.{count}"
        found |= summed_up(rows, stem)
        db = "{:.3f}".format
        print(
            f"{name:10} {count:5} samples, {len(rows)} times: with the noise "
            f"{db(found[f'psnr_db.{stem}.with'])} dB, without {db(found[f'psnr_db.{stem}.without'])} ± "
            f"{db(found[f'psnr_db_se.{stem}.without'])} dB; one says ± {db(found[f'psnr_db_said.{stem}'])}; "
            f"ideal image's noise {found[f'noise_db.{stem}']:.1f} dB; render "
            f"{found[f'seconds.{stem}.render']:.1f} s, photo {found[f'seconds.{stem}.photo']:.2f}, noise "
            f"{found[f'seconds.{stem}.noise']:.2f}",
            flush=True,
        )
    return found


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m benchmarks.truth_noise")
    parser.add_argument("scenes", nargs="*", default=SCENES)
    parser.add_argument("--samples", nargs="+", type=int, default=SAMPLES)
    parser.add_argument("--renders", type=int, default=RENDERS)
    parser.add_argument("--size", nargs=2, type=int, default=(128, 96), metavar=("WIDTH", "HEIGHT"))
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args()
    torch.set_num_threads(1)
    figures: dict[str, float] = {}
    for each in asked.scenes:
        figures |= scored(each, asked.samples, asked.renders, tuple(asked.size))
    if asked.json:
        typed = shlex.join(["python", "-m", "benchmarks.truth_noise", *sys.argv[1:]])
        write_record(asked.json, record("truth_noise", figures=figures, typed=typed))
