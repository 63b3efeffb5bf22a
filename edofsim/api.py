"""The public functions of `import edofsim`: cameras, views, PSFs, plans, photos and restorations in Python.

They put together what the rooms of the package do, as the commands do it. Lengths are in metres, angles in
radians, images linear torch tensors [channel, y, x] with full scale 1.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from .capture import Fidelity, Photo, capture, full_fidelity
from .capture.checks import check_pixel_angle, check_pixels, check_view
from .capture.device import torch_device
from .capture.framing import framed, seen_through
from .capture.guessed import lacks_hidden
from .core.progress import Progress
from .errors import InputError
from .optics import Camera, PsfField, psf_bank
from .plan import Plan, parse_target, plan_photo
from .recipe import Loaded, SceneRecipe, load_camera, load_scene
from .recipe.scene import Bands
from .render import render
from .render.seen import assumptions, by_itself, for_preview
from .render.view import View
from .restore import any_camera_network, choose_network, restore
from .restore.checkpoint import Checkpoint
from .scene.family import members as family_members

NEAREST = 0.5
"""Metres: depths of a photo that is restored without any given, from here to infinity."""


def view(
    scene: str | Path,
    seen_by: Camera | None = None,
    *,
    samples: int | None = None,
    resample: bool = False,
    cache: Path | None = None,
    device: str = "auto",
    progress: Progress | None = None,
) -> View:
    """The view of a scene: rendered, or read from the cache or from the pictures that its recipe names.

    scene: name of a shipped one such as `desk`, or a TOML file.
    seen_by: the camera that frames it; None for the one that the scene names.
    samples: light paths a pixel, in place of the recipe's: fewer are faster and noisier.
    resample: where its pixels see another angle than the camera's, share its light among the camera's pixels.
    cache: folder of rendered views; None for the default one.
    device: `auto`, `cpu` or `cuda`, which renders.
    progress: is given the finished share and a word.

    Raises InputError for what cannot be used, EngineError where nothing can render.
    """
    loaded = load_scene(scene)
    how = {"cache": cache, "device": device, "progress": progress}
    return _rendered(loaded.recipe, loaded, seen_by or _own_camera(loaded), samples, resample, **how)


def _own_camera(scene: Loaded[SceneRecipe]) -> Camera:
    """The one that a scene names."""
    named = load_camera(scene.recipe.camera, scene.base)
    return Camera.from_recipe(named.recipe, named.base)


def _rendered(
    recipe: SceneRecipe,
    scene: Loaded[SceneRecipe],
    seen_by: Camera,
    samples: int | None,
    resample: bool = False,
    **how: Any,  # pyrefly: ignore[explicit-any]
) -> View:
    """The view that a camera has of a recipe of a scene, or of its family. how: of `render`."""
    recipe = framed(recipe, seen_by, resample)
    if samples is not None:
        finer = recipe.render.model_copy(update={"samples": samples})
        recipe = recipe.model_copy(update={"render": finer})
    return seen_through(seen_by, recipe, render(recipe, scene.base, **how))[1]


def views(
    scene: str | Path,
    seen_by: Camera | None = None,
    *,
    members: int,
    samples: int | None = None,
    cache: Path | None = None,
    device: str = "auto",
) -> Iterator[View]:
    """Views of different members of a scene's family, one after another, as `view` gives them.

    scene: name of a shipped one, or a TOML file, with a table [family].
    seen_by: the camera that frames them; None for the one that the scene names.
    members: how many.
    samples: light paths a pixel, in place of the recipe's.
    cache: folder of rendered views; None for the default one.
    device: `auto`, `cpu` or `cuda`, which renders.

    Raises InputError for a scene without a family, and what `view` raises.
    """
    loaded = load_scene(scene)
    seen_by = seen_by or _own_camera(loaded)
    for recipe in family_members(loaded.recipe, members):
        yield _rendered(recipe, loaded, seen_by, samples, cache=cache, device=device)


def look(
    scene: str | Path,
    *,
    samples: int = 16,
    cache: Path | None = None,
    device: str = "auto",
    progress: Progress | None = None,
) -> View:
    """A scene as it is, all sharp, to look at: `.show()` draws it, `.caption()` and `.metadata` say what it
    holds and what was assumed to read it. Its pixels see the angle that the recipe gives, or its file; where
    both leave that open, that of the scene's own camera.

    scene: name of a shipped one such as `desk`, or a TOML file.
    samples: light paths a pixel, where it is rendered.
    cache: folder of rendered views; None for the default one.
    device: `auto`, `cpu` or `cuda`, which renders.
    progress: is given the finished share and a word.

    Raises InputError for what cannot be read, EngineError where nothing can render.
    """
    loaded = load_scene(scene)
    recipe, whose = by_itself(loaded.recipe, loaded.base)
    if recipe is None:
        recipe = framed(loaded.recipe, _own_camera(loaded))
    view = render(for_preview(recipe, samples), loaded.base, cache=cache, device=device, progress=progress)
    return replace(view, metadata={**view.metadata, "assumed": assumptions(view, whose)})


def psfs(
    camera: Camera,
    depths: Sequence[float] | Tensor,
    wavelengths: Sequence[float] | Tensor,
    *,
    window: int | None = None,
) -> PsfField:
    """Point spread functions of a camera.

    camera: its lens, mask and sensor; gradients reach its height map.
    depths: [depth] in metres above 0; `inf` is legal.
    wavelengths: [band] in metres.
    window: width in pixels; None for the camera's.

    Returns a field whose `values` are [depth, band, y, x], the light in each pixel as a fraction of what the
    mask lets through, the middle at pixel n // 2. Raises InputError for depths that are not above 0,
    wavelengths that the glass has no data for, and more PSFs than fit into memory.
    """
    metres = torch.as_tensor(depths, dtype=torch.float64)
    if not bool((metres > 0).all()):
        raise InputError(f"depths {metres.tolist()}: give metres above 0; inf is allowed")
    return psf_bank(camera, wavelengths, 1 / metres, window_px=window)


def plan_for(
    view: View,
    camera: Camera,
    *,
    accuracy: str | None = None,
    time: str | None = None,
    with_: Sequence[str] = (),
    without: Sequence[str] = (),
    network: str | Path | None = None,
    progress: Progress | None = None,
) -> Plan:
    """Which effects a photo calls for, what leaving each out would cost, and what each takes.

    view: what is photographed.
    camera: that photographs it.
    accuracy: `noise` (the default: less error than half of the sensor's noise), `restored` (near enough that
        what a network makes of the photo keeps its PSNR), `full`, or decibels such as `45dB`.
    time: such as `2s`, in place of an accuracy: the best within it.
    with_: names of effects that are simulated in full, whatever the plan says.
    without: names of effects that are not simulated, whatever the plan says.
    network: of no effect any more.
    progress: is given the finished share and a word.

    Raises InputError for what is not known.
    """
    overrule = {"with_": list(with_) or None, "without": list(without) or None}
    return plan_photo(view, camera, overrule, parse_target(accuracy, time), progress=progress)


def _check_sub_apertures(fidelity: Fidelity, view: View) -> None:
    """Raises InputError for sub-apertures that a fidelity asks for and cannot simulate."""
    if fidelity.sub_apertures == 1:
        return
    if fidelity.occlusion != "hidden":
        raise InputError(
            f"sub_apertures = {fidelity.sub_apertures} belong to the occlusion `hidden` alone, not to "
            f"{fidelity.occlusion!r}: choose one of them"
        )
    if not fidelity.hidden_surfaces and lacks_hidden(view):
        raise InputError(
            f"sub_apertures = {fidelity.sub_apertures}: the view holds nothing behind its edges to be seen "
            "past them: leave hidden_surfaces = True to have it guessed"
        )


def photograph(
    view: View | Sequence[View],
    camera: Camera,
    plan: Plan | Fidelity | None = None,
    *,
    accuracy: str | None = None,
    time: str | None = None,
    exposure: float | None = None,
    seed: int = 0,
    dtype: torch.dtype = torch.float32,
    device: torch.device | str = "cpu",
    progress: Progress | None = None,
) -> Photo:
    """A photo, simulated as a plan or a fidelity says. Gradients reach the view's light and the camera's
    height map.

    view: one, or several of one size and the same bands, which share PSFs and exposure.
    camera: that photographs it.
    plan: None for one for `accuracy` or `time`, which looks only at effects that can save time; several views
        are simulated in full without one.
    accuracy: as for `plan_for`; `full` simulates all that view and camera have, without a plan.
    time: such as `2s`, in place of an accuracy: the best within it.
    exposure: factor from radiance to full scale; None for the camera's.
    seed: of the sensor's noise; several views have this and the next ones.
    dtype: float32 or float64.
    device: that computes.
    progress: is given the finished share and a word.

    Returns its image, [channel, y, x] or [view, channel, y, x], the one without noise and the ideal one.
    Raises InputError for a view that the camera cannot photograph, and for a plan together with an accuracy
    or time.
    """
    if plan is not None and (accuracy or time):
        raise InputError("photograph: give a plan, or an accuracy or time to make one for")
    views = [view] if isinstance(view, View) else view
    if not (isinstance(views, Sequence) and views and all(isinstance(each, View) for each in views)):
        raise InputError(f"photograph takes a View, or a list of them, not a {type(view).__name__}")
    device = torch_device(device) if isinstance(device, str) else device
    for each in views:
        check_pixels(each)  # before a plan takes its time
        check_view(each)
        check_pixel_angle(each, camera.pixel_angle)
    if plan is None and len(views) > 1 and not (accuracy in (None, "full") and time is None):
        raise InputError("photograph: a plan is for one view; make it for one, and give it for several")
    if plan is None and time is None and (accuracy == "full" or len(views) > 1):
        every = [full_fidelity(camera, each) for each in views]
        plan = max(every, key=lambda full: (full.occlusion == "hidden", full.sub_apertures))
    if plan is None:
        target = parse_target(accuracy, time)
        plan = plan_photo(views[0], camera, target=target, every_effect=False, progress=progress)
    fidelity = plan.fidelity.of_photo() if isinstance(plan, Plan) else plan
    for each in views:
        _check_sub_apertures(fidelity, each)
    how = {"exposure": exposure, "seed": seed, "dtype": dtype, "device": device, "progress": progress}
    return capture(view, camera, fidelity, **how)


def restored(
    photo: Photo | Tensor,
    camera: Camera,
    *,
    network: str | Path | None = None,
    depths: tuple[float, float] = (NEAREST, math.inf),
    wavelengths: Sequence[float] | Tensor | None = None,
) -> Tensor:
    """The sharp image of a photo, without what lamps have beyond full scale. The camera is taken as it is: a
    network that was trained with another mask restores badly.

    photo: a `Photo`, or any linear image [3, y, x], full scale 1.
    camera: that took it.
    network: checkpoint (file or shipped name) that restores; `wiener` for Wiener deconvolution; None for the
        network that was trained with the camera's mask, or the one for any camera where there is none.
    depths: nearest and farthest [m] that the photo may hold, for Wiener deconvolution and `universal`.
    wavelengths: [band] in metres that it was taken in; None for 31 from 420 to 720 nm.

    Returns a linear image [3, y, x], full scale 1. Raises InputError for depths that are none, and a
    checkpoint that is damaged or of another camera.
    """
    near, far = depths
    if not 0 < near <= far:
        raise InputError(f"depths {depths}: give (nearest, farthest) in metres, 0 < nearest <= farthest")
    image = photo.image if isinstance(photo, Photo) else _image(photo)
    if not (network is None or isinstance(network, str | Path)):
        raise InputError(
            f"network is a {type(network).__name__}: name a checkpoint, by a file or a shipped name, or "
            "wiener"
        )
    bands = torch.as_tensor(Bands().wavelengths() if wavelengths is None else wavelengths)
    checkpoint = _checkpoint(camera, network)
    truncated = photo.truncated if isinstance(photo, Photo) else None
    between = torch.tensor([1 / far, 1 / near], dtype=torch.float64)
    sharp, _ = restore(image, camera, bands.double(), between, checkpoint=checkpoint, truncated=truncated)
    return sharp


def _image(photo: object) -> Tensor:
    """A linear image [channel, y, x]. Raises InputError for what is none."""
    if isinstance(photo, str | Path):
        raise InputError(f"{photo}: give the image itself, edofsim.read_image({str(photo)!r})")
    if isinstance(photo, np.ndarray) and photo.dtype.kind in "fiub":
        photo = torch.from_numpy(np.array(photo, np.float32))
    if not isinstance(photo, Tensor):
        raise InputError(f"a photo is a Photo or a tensor [3, y, x], not a {type(photo).__name__}")
    if photo.ndim != 3 or len(photo) != 3 or not photo.is_floating_point():
        raise InputError(
            f"a photo is one image [3, y, x] of floats, not {list(photo.shape)}, {photo.dtype}: put the "
            "channels first, and restore several one by one"
        )
    return photo


def _checkpoint(camera: Camera, network: str | Path | None) -> Checkpoint | None:
    """What restores photos of a camera, see `restored`; None for Wiener deconvolution."""
    if network is None and camera.mask_given:
        return any_camera_network()  # the recipe's own knows the recipe's mask
    return choose_network(network, Loaded(camera.recipe, camera.base / "camera.toml", ""))[0]
