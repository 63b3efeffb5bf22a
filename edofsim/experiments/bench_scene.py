"""The paper's bench, a bus at 0.5 m and a car at 1.3 m: lens alone, the mask as designed, the mask as made.

Akpinar et al., section "Experimental Results": a real photo with the DOE and one without it, the lens focused
at 1.3 m in the green. Here the scene is built and rendered, so that there is a truth to score against; the
mask as made has their device's errors: 98 levels, heights off by 44 nm on average, 49.5 nm of scatter.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from ..optics import Camera
from ..recipe import Loaded, SceneRecipe, load_camera, load_scene
from ..recipe.fabrication import Fabrication
from ..render import View, render
from ..restore.checkpoint import shipped_checkpoints
from ..scene import build_scene
from . import scene3d
from .protocols import WAYS, System, systems_of

Progress = Callable[[float, str], None]

SCENE = "bench"
OBJECTS = ("bus", "car")
MADE = "made"


def run(
    folder: Path,
    *,
    networks: Sequence[str] | None = None,
    camera: str | None = None,
    quick: bool = False,
    seed: int = 0,
    cache: Path | None = None,
    show: Callable[[scene3d.Measured, scene3d.Seen, dict[str, Tensor]], None] | None = None,
    progress: Progress | None = None,
) -> scene3d.Measured:
    """Measure the bench. See `scene3d.run`; `show` also gets the pixels of each object, bool [y, x].

    quick: the middle of the frame, and no mask as made, whose PSFs take minutes.
    """
    networks = networks or list(shipped_checkpoints())
    say = progress or (lambda fraction, text: None)
    scene = load_scene(SCENE)
    taker = load_camera(camera or scene.recipe.camera, None if camera else scene.base)
    recipe = scene3d.scored_version(scene.recipe, quick=quick)
    key = scene3d.key_of(recipe, scene.base, taker, networks, seed)
    path = scene3d.record_path(folder, SCENE)
    known = scene3d.read(path, key)
    if known is not None:
        return known
    view = render(recipe, scene.base, cache=cache, progress=lambda f, t: say(0.4 * f, t))
    systems = systems_of(taker, networks)
    if not quick:
        systems += [as_made(system, seed) for system in systems[1:]]
    parts = object_pixels(scene, view)
    measured, taken, edges = scene3d.measure(
        SCENE,
        view,
        systems,
        ways=(WAYS[0], WAYS[-1]),
        parts=parts,
        seed=seed,
        progress=lambda f, t: say(0.4 + 0.6 * f, t),
    )
    if show:
        show(measured, scene3d.Seen(scene, taker, view, tuple(systems), taken, edges), parts)
    scene3d.write(path, key, measured)
    return measured


def as_made(system: System, seed: int = 0) -> System:
    """The system with its mask as the paper's device was made."""
    fabrication = Fabrication(preset="paper-device", seed=seed)
    recipe = system.camera.recipe.model_copy(update={"fabrication": fabrication})
    camera = Camera.from_recipe(recipe, system.camera.base)
    return replace(system, name=f"{system.name}-{MADE}", camera=camera, designed=system.camera)


def object_pixels(scene: Loaded[SceneRecipe], view: View) -> dict[str, Tensor]:
    """Where each of `OBJECTS` is seen in the frame, bool [y, x]: inside the outline's box, at its depths."""
    model = build_scene(scene.recipe, scene.base)
    depth = view.crop_margin(view.mean_inverse_depth())
    found = {}
    for name in OBJECTS:
        own = [thing.mesh.vertices for thing in model.objects if thing.name.split("/")[0] == name]
        vertices = np.concatenate(own).astype(np.float64)
        x, y = vertices[:, 0] / vertices[:, 2], vertices[:, 1] / vertices[:, 2]
        columns = x / view.pixel_angle + view.width / 2
        rows = view.height / 2 - y / view.pixel_angle
        mask = torch.zeros(view.height, view.width, dtype=torch.bool)
        mask[_span(rows, view.height), _span(columns, view.width)] = True
        near, far = vertices[:, 2].min(), vertices[:, 2].max()
        found[name] = mask & (depth <= 1 / near * 1.001) & (depth >= 1 / far * 0.999)
    return found


def _span(values: np.ndarray, size: int) -> slice:
    return slice(int(np.clip(values.min(), 0, size)), int(np.clip(np.ceil(values.max()), 0, size)))


def figures(measured: scene3d.Measured) -> dict[str, float]:
    """Flat: psnr_db and ssim .WAY.IMAGE, and .WAY.IMAGE.OBJECT; IMAGE as in `scene3d.figures`, the mask as
    made called NETWORK-made; WAY is `paper` or `hidden` (ours)."""
    found = {}
    for row in measured.rows:
        if row.region not in (scene3d.WHOLE, *OBJECTS):
            continue
        image = row.system if row.image == "restored" else f"{row.system}.{row.image}"
        image = row.system if row.system == scene3d.LENS_ALONE else image
        where = "" if row.region == scene3d.WHOLE else f".{row.region}"
        found[f"psnr_db.{row.way}.{image}{where}"] = row.psnr_db
        found[f"ssim.{row.way}.{image}{where}"] = row.ssim
    return found
