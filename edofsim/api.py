"""The public functions of `import edofsim`: cameras, views, PSFs, plans, photos and restorations in Python.

They put together what the rooms of the package do, as the commands do it. Lengths are in metres, angles in
radians, images linear torch tensors [channel, y, x] with full scale 1.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

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
from .recipe import CameraRecipe, Loaded, load_camera, load_scene
from .recipe.scene import Bands
from .recipe.toml import validate
from .render import render
from .render.seen import assumptions, by_itself, for_preview
from .render.view import View
from .restore import restore
from .restore.checkpoint import Checkpoint, camera_with_mask, load_checkpoint
from .restore.choice import any_camera_network, choose_network
from .scene.family import members as family_members

NEAREST = 0.5
"""Metres: depths of a photo that is restored without any given, from here to infinity."""


def camera(
    source: str | Path | None = None,
    *,
    focal_length: float | None = None,
    f_number: float | None = None,
    focus: float | None = None,
    pixel: float | None = None,
    read_noise: float | None = None,
    full_well: float | None = None,
    bits: int | None = None,
    bayer: str | None = None,
    window: int | None = None,
    mask: Mapping[str, object] | None = None,
    name: str | None = None,
    height: Tensor | np.ndarray | None = None,
    pitch: float | None = None,
    material: str | None = None,
    network: str | Path | None = None,
) -> Camera:
    """A camera: a shipped one by name, a recipe's, or one given by numbers.

    source: name such as `paper-learned`, or a TOML file; None for the paper's lens without a mask.
    focal_length: of an ideal lens in place of that one's [m], which takes an f_number too.
    f_number: focal length over the width of the aperture.
    focus: the distance that is sharp [m].
    pixel: pitch of the sensor [m].
    read_noise: standard deviation, full scale 1.
    full_well: electrons at full scale, for shot noise.
    bits: of the quantisation.
    bayer: the mosaic's first four pixels, such as `RGGB`.
    window: width of the PSFs, pixels.
    mask: the table [mask] of a recipe, such as `{"kind": "cubic", "alpha_rad": 60}`; `file` in it is relative
        to the working folder.
    name: of the camera, in tables and reports.
    height: height map of the mask [n, n] in metres, row 0 the top of the pupil; gradients reach a tensor.
    pitch: of the height map's samples [m]; None where they just cover the pupil.
    material: of the height map; None for the photoresist S1813.
    network: checkpoint whose mask the camera has.

    Raises InputError for what cannot be a camera, naming every problem.
    """
    given = CameraRecipe(name="paper-clear") if source is None else None
    loaded = Loaded(given, Path.cwd() / "camera.toml", "") if given else load_camera(source or "")
    recipe, base = loaded.recipe, loaded.base
    _check_lengths(focal_length=focal_length, pixel=pixel, pitch=pitch)
    if mask is not None and not (height is None and network is None):
        raise InputError("the mask is that of mask, of height or of network: give one of them")
    if (focal_length is None) != (f_number is None):
        raise InputError("focal_length and f_number belong together: give both, or neither")
    if height is None and not (pitch is None and material is None):
        raise InputError("pitch and material are those of a height map: give height as well")
    if height is not None and network is not None:
        raise InputError("the mask is that of height, or that of network: give one of them")
    tables: dict[str, dict[str, object]] = {}
    if focal_length is not None and f_number is not None:
        lens: dict[str, object] = {"kind": "ideal", "f_number": f_number}
        lens["focal_length_mm"] = focal_length * 1e3
        tables["lens"] = lens
    given = recipe.model_dump(mode="json", exclude_unset=True)
    for table, key, value in (
        ("focus", "distance_m", focus),
        ("sensor", "pixel_um", None if pixel is None else pixel * 1e6),
        ("sensor", "read_noise", read_noise),
        ("sensor", "full_well_electrons", full_well),
        ("sensor", "bits", bits),
        ("sensor", "bayer", bayer),
        ("psf", "window_px", window),
    ):
        if value is not None:
            tables.setdefault(table, dict(given.get(table, {})))[key] = value
    given_map = None if height is None else _heights(height)
    if mask is not None:
        tables["mask"] = dict(mask)
    if given_map is not None and (pitch is not None or material is not None):
        clear = CameraRecipe.model_validate(_with(given, tables) | {"mask": {"kind": "clear"}})
        across = 2 * Camera.from_recipe(clear, base).aperture_radius * (1 + 1e-12) / given_map.shape[0]
        made_of: dict[str, object] = {} if material is None else {"material": material}
        pitch_um = (across if pitch is None else pitch) * 1e6
        tables["mask"] = {"kind": "height-map", "pitch_um": pitch_um, **made_of}
    if tables or name:
        recipe = validate(CameraRecipe, _with(given, tables, name))
    if network is not None:
        return camera_with_mask(recipe, load_checkpoint(network, recipe), base)
    made = Camera.from_recipe(recipe, base)
    return made if given_map is None else made.with_height(given_map)


def _with(
    given: Mapping[str, object], tables: Mapping[str, object], name: str | None = None
) -> dict[str, object]:
    """What a recipe says with other tables, and under another name."""
    return {**given, **tables, **({} if name is None else {"name": name})}


def _check_lengths(**lengths: float | None) -> None:
    """Raises InputError for lengths of small things that are metres: numbers of another unit look so."""
    small = {"focal_length": (10.0, "mm", 1e-3), "pixel": (1e-3, "um", 1e-6), "pitch": (1e-2, "um", 1e-6)}
    for name, value in lengths.items():
        most, unit, metres = small[name]
        if value is not None and value >= most:
            raise InputError(
                f"{name} = {value:g} m: lengths are in metres; {value:g} {unit} is {value * metres:.6g}"
            )


def _heights(height: object) -> Tensor:
    """A height map [n, n] as a tensor. Raises InputError for what is none."""
    if isinstance(height, str | Path):
        raise InputError(
            f"height = {str(height)!r}: give an array [n, n] in metres; a file goes into "
            'mask={"kind": "height-map", "file": ..., "pitch_um": ...}'
        )
    if isinstance(height, Tensor):
        found = height
    else:
        values = np.asarray(height)
        if values.dtype.kind not in "buif":
            raise InputError(f"height holds {values.dtype}, not real numbers: give an array [n, n] in metres")
        found = torch.tensor(np.array(values, float))
    if found.ndim != 2 or found.shape[0] != found.shape[1]:
        raise InputError(f"height has the shape {list(found.shape)}; a height map is square, [n, n]")
    return found


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
    if seen_by is None:
        named = load_camera(loaded.recipe.camera, loaded.base)
        seen_by = Camera.from_recipe(named.recipe, named.base)
    recipe = framed(loaded.recipe, seen_by, resample)
    if samples is not None:
        finer = recipe.render.model_copy(update={"samples": samples})
        recipe = recipe.model_copy(update={"render": finer})
    found = render(recipe, loaded.base, cache=cache, device=device, progress=progress)
    return seen_through(seen_by, recipe, found)[1]


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
    if seen_by is None:
        named = load_camera(loaded.recipe.camera, loaded.base)
        seen_by = Camera.from_recipe(named.recipe, named.base)
    for recipe in family_members(loaded.recipe, members):
        framed_member = framed(recipe, seen_by)
        if samples is not None:
            finer = framed_member.render.model_copy(update={"samples": samples})
            framed_member = framed_member.model_copy(update={"render": finer})
        found = render(framed_member, loaded.base, cache=cache, device=device)
        yield seen_through(seen_by, framed_member, found)[1]


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
        named = load_camera(loaded.recipe.camera, loaded.base)
        recipe = framed(loaded.recipe, Camera.from_recipe(named.recipe, named.base))
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
        raise InputError(f"depths {metres.tolist()}: give metres above 0; inf is legal")
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
    """The sharp image of a photo. The camera is taken as it is: a network that was trained with another mask
    restores badly.

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
    if network is None and camera.height_map is not None:
        return any_camera_network()  # the recipe's own knows the recipe's mask
    return choose_network(network, Loaded(camera.recipe, camera.base / "camera.toml", ""))[0]
