"""One part of a data set: its view rendered, photographed by each of its cameras, and the pairs written."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from ..capture import Fidelity, Photo, capture, ideal_image
from ..capture.depth_edges import edge_distance
from ..capture.device import torch_device
from ..capture.fidelity_file import fidelity_of_values, values_of
from ..capture.framing import seen_through
from ..capture.noise import photo_noise
from ..capture.sensor import automatic_exposure, record, sensor_effects
from ..core.json_values import Json
from ..core.progress import Progress, part
from ..optics import Camera
from ..plan import parse_target, plan_photo
from ..recipe.dataset import DatasetRecipe
from ..recipe.scene import SceneRecipe
from ..record import versions
from ..render import render
from ..render.fetch import place_of
from ..render.view import View
from .kept import Folder
from .parts import Part, Work, drawn_for, keys_of

NOISE = ("noise.ideal", "noise.photo")
"""Names of what two halves of the samples differ by, in the ideal image and in the photo."""


@dataclass(frozen=True)
class Exposed:
    """A photo of a view, before its noise: how it was made, and what the noise of the rendering is in it."""

    photo: Photo
    camera: Camera
    fidelity: Fidelity
    noise: Mapping[str, Tensor]


def take_part(
    number: int, progress: Progress, *, work: Work, folder: Folder, device: str = "auto"
) -> dict[str, float]:
    """All pairs of part `number` that are not there yet. Returns seconds of the processor of this process by
    what they were spent on, empty where all were there."""
    chosen = work.parts[number]
    spent = {"render": 0.0, "photos": 0.0}
    cameras = work.cameras(chosen)
    for place, (camera, frame) in enumerate(zip(cameras, work.frames(chosen), strict=True)):
        say = part(progress, place / len(cameras), (place + 1) / len(cameras), camera.recipe.name)
        keys = keys_of(chosen, camera, work.recipe.photos.noise_seeds)
        if all(folder.has(key) for key in keys):
            continue
        began = time.process_time()
        base = chosen.scene.base
        view = render(frame, base, cache=folder.views, device=device, progress=part(say, 0.0, 0.7))
        view = seen_through(camera, frame, view)[1]
        rendered = time.process_time()
        say(0.7, "photo")
        exposed = expose(view, camera, work.recipe, f"{chosen.name}_{camera.recipe.name}", device)
        for noise, key in enumerate(keys):
            write_pair(folder, key, view, exposed, work.recipe, noise, _about(chosen, frame, camera))
        spent["render"] += rendered - began
        spent["photos"] += time.process_time() - rendered
    if not work.recipe.store.keep_views:
        for frame in work.frames(chosen):
            place_at = place_of(frame, chosen.scene.base, folder.views, None)
            for suffix in ("exr", "json", "lock", "partial"):
                with suppress(FileNotFoundError):
                    place_at.file(suffix).unlink()
    return spent if sum(spent.values()) else {}


def expose(view: View, camera: Camera, recipe: DatasetRecipe, key: str, device: str = "cpu") -> Exposed:
    """The photo of a view as a recipe asks for.

    key: what its exposure and read noise are drawn by.
    """
    photos = recipe.photos
    rng = drawn_for(recipe, key)
    low, high = photos.exposure
    factor = low * (high / low) ** float(rng.random())
    if photos.read_noise is not None:
        camera = camera.with_read_noise(float(rng.uniform(*photos.read_noise)))
    if photos.fidelity is not None:
        fidelity = fidelity_of_values(photos.fidelity, "photos.fidelity", Fidelity)
    else:
        target = parse_target(photos.accuracy, None)
        fidelity = plan_photo(view, camera, target=target, every_effect=False).fidelity.of_photo()
    ideal = view.crop_margin(ideal_image(view, camera, 1.0))
    wanted = camera.recipe.sensor.exposure
    exposure = automatic_exposure(ideal, noisy=view.noise > 0) if wanted == "auto" else float(wanted)
    compute = torch_device(device)
    photo = capture(view, camera, fidelity, exposure=factor * exposure, device=compute)
    noise: dict[str, Tensor] = {}
    if photos.rendering_noise:
        found = photo_noise(view, camera, fidelity, photo, compute)
        if found.ideal is not None and found.image is not None:
            noise = dict(zip(NOISE, (found.ideal.cpu(), found.image.cpu()), strict=True))
    return Exposed(photo, camera, fidelity, noise)


def sensor_image(exposed: Exposed, recipe: DatasetRecipe, key: str) -> tuple[Tensor, int]:
    """What the sensor records, [channel, y, x], and the seed of its noise: that of the pair's key."""
    seed = int(drawn_for(recipe, key).integers(1 << 31))
    effects = sensor_effects(exposed.camera, exposed.fidelity)
    return record(exposed.photo.clean, effects, seed), seed


def write_pair(
    folder: Folder, key: str, view: View, exposed: Exposed, recipe: DatasetRecipe, noise: int, about: Json
) -> None:
    """The pair of a key, with the noise of its own."""
    photo = exposed.photo
    image, seed = sensor_image(exposed, recipe, key)
    depth = view.crop_margin(view.mean_inverse_depth())
    ends = torch.stack(view.inverse_depth.aminmax()).tolist()
    images = {"photo": image, "clean": photo.clean, "ideal": photo.ideal, **exposed.noise}
    meta = {
        **about,
        "key": key,
        "noise": noise,
        "noise_seed": seed,
        "exposure": photo.exposure,
        "read_noise": exposed.camera.read_noise,
        "truncated": photo.truncated.tolist(),
        "inverse_depths": ends,
        "rendering_noise": "kept" if exposed.noise else "none" if view.noise == 0 else "included",
        "fidelity": values_of(exposed.fidelity),
        "versions": versions(),
    }
    planes = {name: tensor.detach().cpu().numpy() for name, tensor in images.items()}
    planes["inverse_depth"] = depth.cpu().numpy()
    planes["edge_px"] = edge_distance(view, exposed.camera).numpy()
    folder.write(key, planes, meta, np.float16 if recipe.store.precision == "half" else np.float32)


def _about(chosen: Part, frame: SceneRecipe, camera: Camera) -> Json:
    """What a pair is of: the same for all seeds of its noise."""
    recipe = frame.model_dump_json(exclude={"purpose", "camera"})
    return {
        "scene": chosen.name,
        "family": chosen.family,
        "split": chosen.split,
        "member_seed": frame.seed,
        "camera": camera.recipe.name,
        "recipe_sha256": hashlib.sha256(recipe.encode()).hexdigest(),
        "view": place_of(frame, chosen.scene.base, Path("views"), None).file("exr").name,
        "pixel_angle": camera.pixel_angle,
    }
