"""What a guess behind depth edges is worth: rendered views whose hidden fragments were taken away.

`python -m benchmarks.behind_edges [SCENE...] [--json FILE]` photographs small frames of shipped scenes and
of members of families, three bands, through shipped cameras, and prints PSNR in dB near depth edges (within
the blur radius, see `near_edges`) of photos without noise, against the photo with the hidden fragments that
were rendered: `none` adds all light, `over` and `normalised` know visible surfaces, `guessed` continues what
is behind edges from next to them (the default). Last, the processor seconds of the guess over those of the
photo; the guess with other ways to fill in light, where `--fills` asks for them.
"""

from __future__ import annotations

import argparse
import shlex
import statistics
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from unittest import mock

import numpy as np
import torch
from torch import Tensor

from edofsim.capture import Fidelity, capture, guessed
from edofsim.capture.depth_edges import near_edges
from edofsim.capture.guessed import with_guessed
from edofsim.optics import Camera
from edofsim.recipe import SceneRecipe, load_camera, load_scene
from edofsim.record import record, write_record
from edofsim.render import render
from edofsim.render.view import View
from edofsim.scene.family import member

Fill = Callable[[Tensor, Tensor], Tensor]
SCENES = ("desk", "hallway", "clutter", "foliage", "stilllife", "bench", "families/kitchen", "families/wires")
CAMERAS = ("paper-clear", "paper-learned")
WAYS = ("none", "over", "normalised")
SIDE, SAMPLES, MEMBER = 128, 16, 7


def small(recipe: SceneRecipe) -> SceneRecipe:
    """The middle of a scene in three bands, with few samples."""
    frame = recipe.frame.model_copy(update={"height_px": SIDE, "width_px": SIDE})
    bands = recipe.bands.model_copy(update={"start_nm": 482.0, "stop_nm": 611.0, "count": 3})
    coarse = recipe.render.model_copy(update={"samples": SAMPLES, "hidden": True})
    return recipe.model_copy(update={"frame": frame, "bands": bands, "render": coarse})


def taken_away(view: View) -> View:
    """The view without its hidden fragments, as if nobody had looked for them."""
    kept = ~view.hidden
    return replace(
        view,
        pixel=view.pixel[kept],
        coverage=view.coverage[kept],
        inverse_depth=view.inverse_depth[kept],
        radiance=view.radiance[:, kept],
        hidden=view.hidden[kept],
        half_difference=None,
        metadata={},
    )


def figures(view: View, camera: Camera, fills: Mapping[str, Fill]) -> dict[str, float]:
    """PSNR of each way, by name; and `seconds_share`. Empty for a view without depth edges."""
    near = near_edges(view, camera)
    if not bool(near.any()) or not bool(view.hidden.any()):
        return {}
    truth = capture(view, camera, Fidelity(layers_db=60.0))
    seen = taken_away(view)

    def db(fidelity: Fidelity) -> float:
        photo = capture(seen, camera, fidelity, exposure=truth.exposure)
        wrong = (photo.clean - truth.clean)[:, near].double().square().mean()
        return float(-10 * torch.log10(wrong))

    usual = Fidelity(layers_db=60.0)
    found = {way: db(usual.changed({"occlusion": way})) for way in WAYS}
    begin = time.process_time()
    found["guessed"] = db(usual)
    photo = time.process_time() - begin
    begin = time.process_time()
    with_guessed(seen, camera)
    found["seconds_share"] = (time.process_time() - begin) / photo
    for name, fill in fills.items():
        with mock.patch.object(guessed, "push_pull", fill):
            begin = time.process_time()
            found[name] = db(usual)
            found[f"seconds.{name}"] = time.process_time() - begin
    return found


def biharmonic(light: Tensor, weight: Tensor) -> Tensor:
    """As `push_pull`, by scikit-image's `inpaint_biharmonic`, of the pixels of which less than half is
    known."""
    from skimage.restoration import inpaint_biharmonic

    known = (light / weight.clamp_min(1e-6)).detach().numpy()
    image = inpaint_biharmonic(np.moveaxis(known, 0, -1), weight.numpy() < 0.5, channel_axis=-1)
    return torch.from_numpy(np.moveaxis(image, -1, 0)).to(light).clamp_min(0)


def measured(scenes: list[str], fills: Mapping[str, Fill]) -> dict[str, float]:
    """Figures by `WAY.SCENE.CAMERA`, with the mean and the least over all cases."""
    found: dict[str, float] = {}
    cases: dict[str, list[float]] = {}
    for scene in scenes:
        family = scene.startswith("families/")
        loaded = load_scene(f"scenes/{scene}.toml" if family else scene)
        recipe = member(loaded.recipe, MEMBER) if family else loaded.recipe
        for name in CAMERAS:
            there = load_camera(name)
            camera = Camera.from_recipe(there.recipe, there.base)
            view = render(small(recipe).seen_at(camera.pixel_angle), loaded.base)
            here = figures(view, camera, fills)
            print(f"{scene:18} {name:14}", *(f"{k} {v:.2f}" for k, v in here.items()), sep="  ", flush=True)
            for way, value in here.items():
                found[f"{way}.{scene}.{name}"] = value
                cases.setdefault(way, []).append(value)
    for way, values in cases.items():
        found |= {f"{way}.mean": statistics.mean(values), f"{way}.least": min(values)}
        print(f"{way:14} mean {statistics.mean(values):.2f}  least {min(values):.2f}")
    if cases:
        gain = [a - b for a, b in zip(cases["guessed"], cases["normalised"], strict=True)]
        found["gain.least"] = min(gain)
        print(f"guessed over normalised: mean {statistics.mean(gain):.2f}  least {min(gain):.2f} dB")
    return found


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m benchmarks.behind_edges")
    parser.add_argument("scenes", nargs="*", default=SCENES)
    parser.add_argument("--fills", action="store_true", help="scikit-image's biharmonic filling as well")
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args()
    result = measured(list(asked.scenes), {"biharmonic": biharmonic} if asked.fills else {})
    if asked.json:
        typed = shlex.join(["python", "-m", "benchmarks.behind_edges", *sys.argv[1:]])
        write_record(asked.json, record("behind_edges", figures=result, typed=typed))
