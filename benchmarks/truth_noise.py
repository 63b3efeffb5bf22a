"""What the rendering's own noise costs a score, and whether scores are without it, by samples a pixel.

`python -m benchmarks.truth_noise [SCENE...] [--samples N...] [--size WIDTH HEIGHT] [--json FILE]` renders the
middles of scenes, at their own pixels, photographs them through the scene's camera as the plan of the fewest
samples says, restores them by the camera's network, and scores them with the truth's noise (as scores were
taken before) and without. Each row's exposure is its own.
Figures: `psnr_db.SCENE.SAMPLES.{with,without}`, `psnr_db_se.SCENE.SAMPLES.without`, `ssim.*`, `ssim_se.*`
alike, `noise_db.SCENE.SAMPLES` (of the ideal image), `seconds.SCENE.SAMPLES.{render,photo,noise}`
(processor's; a render from the cache takes next to nothing).
"""

from __future__ import annotations

import argparse
import math
import shlex
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import torch
from torch import Tensor

from edofsim.capture import Fidelity, capture
from edofsim.capture.noise import photo_noise
from edofsim.optics.nodes import nodes_between
from edofsim.plan import plan_photo
from edofsim.recipe.load import load_camera, load_scene
from edofsim.record import record, write_record
from edofsim.render import render
from edofsim.restore import choose_network, restore
from edofsim.restore.scores import image_psnr, score
from edofsim.restore.truth import Truth

Made = TypeVar("Made")
SCENES = ("desk", "hallway", "foliage", "stilllife", "night")
SAMPLES = (16, 64, 256, 2048)
MARGIN = 48


def timed(work: Callable[[], Made]) -> tuple[Made, float]:
    """What it makes, and the processor's seconds."""
    started = time.process_time()
    return work(), time.process_time() - started


def scored(name: str, samples: list[int], size: tuple[int, int]) -> dict[str, float]:
    """The figures of a scene; prints a line for each number of samples."""
    scene = load_scene(name)
    frame = {"width_px": size[0], "height_px": size[1], "margin_px": MARGIN}
    checkpoint, camera = choose_network(None, load_camera(scene.recipe.camera, scene.base))
    fidelity: Fidelity | None = None
    found: dict[str, float] = {}
    for count in samples:
        drawn = scene.recipe.render.model_copy(update={"samples": count})
        recipe = scene.recipe.model_copy(
            update={"render": drawn, "frame": scene.recipe.frame.model_copy(update=frame)}
        )
        view, rendering = timed(lambda recipe=recipe: render(recipe, scene.base))
        fidelity = fidelity or plan_photo(view, camera, every_effect=False).fidelity
        photo, photographing = timed(lambda view=view, how=fidelity: capture(view, camera, how))
        depths = nodes_between(camera, view.wavelengths, *view.inverse_depth.aminmax())

        def restores(image: Tensor, view=view, depths=depths, photo=photo) -> Tensor:
            how = {"checkpoint": checkpoint, "truncated": photo.truncated}
            return restore(image, camera, view.wavelengths, depths, **how)[0]

        restored = restores(photo.image)

        def noise(view=view, photo=photo, restored=restored, restores=restores, how=fidelity):
            truth = Truth(photo.ideal, photo_noise(view, camera, how, photo))
            return truth, truth.restored_noise(photo.image, restored, restores)

        (truth, left), once_more = timed(noise)
        before, after = score(restored, photo.ideal), score(*truth.compared(restored, left))
        level = math.inf
        if truth.noise.ideal is not None:
            level = image_psnr(photo.ideal + truth.noise.ideal, photo.ideal)
        stem = f"{name}.{count}"
        for metric in ("psnr_db", "ssim"):
            found[f"{metric}.{stem}.with"] = getattr(before, metric)
            found[f"{metric}.{stem}.without"] = getattr(after, metric)
            found[f"{metric}_se.{stem}.without"] = getattr(after, f"{metric}_se")
        found[f"noise_db.{stem}"] = level
        parts = {"render": rendering, "photo": photographing, "noise": once_more}
        found |= {f"seconds.{stem}.{part}": seconds for part, seconds in parts.items()}
        print(
            f"{name:10} {count:5} samples: with the noise {before.psnr_db:.3f} dB {before.ssim:.4f}, without "
            f"{after.psnr_db:.3f} ± {after.psnr_db_se:.3f} dB {after.ssim:.4f} ± {after.ssim_se:.4f}; ideal "
            f"image's noise {level:.1f} dB; render {rendering:.1f} s, photo {photographing:.2f}, noise "
            f"{once_more:.2f}",
            flush=True,
        )
    return found


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m benchmarks.truth_noise")
    parser.add_argument("scenes", nargs="*", default=SCENES)
    parser.add_argument("--samples", nargs="+", type=int, default=SAMPLES)
    parser.add_argument("--size", nargs=2, type=int, default=(128, 96), metavar=("WIDTH", "HEIGHT"))
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args()
    torch.set_num_threads(1)
    figures: dict[str, float] = {}
    for each in asked.scenes:
        figures |= scored(each, asked.samples, tuple(asked.size))
    if asked.json:
        typed = shlex.join(["python", "-m", "benchmarks.truth_noise", *sys.argv[1:]])
        write_record(asked.json, record("truth_noise", figures=figures, typed=typed))
