"""The camera: from views to a photo, the paper's Eqs. `Forwardmodel` and `SensorImage` with occlusion.

One operator for every photo that is made anywhere.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import torch
from torch import Tensor

from ..core.json_values import Json
from ..core.progress import Progress
from ..core.progress import part as part_of
from ..core.stopwatch import Stopwatch
from ..errors import InputError
from ..optics import Camera, response
from ..optics.camera import defocus_per_dioptre
from ..optics.precision import own_precision
from ..optics.pupil import transmission
from ..recipe import CameraRecipe
from ..render.view import View
from .band_limit import BandLimit
from .blurring import Blurring
from .checks import check_fidelity, check_pixel_angle, check_window, distortion_of
from .fidelity import Fidelity
from .fidelity_file import values_of
from .field import Part, change_over_field, field_step, frame_of, image_over_field, in_terms, over_field
from .guessed import guessed_fragments, lacks_hidden, with_guessed
from .imaging import Axes, Imaging, imaging_of, spectrum_of, sub_aperture_imaging
from .light import hat_weights, seen
from .occlusion.hidden import Layout
from .photo import How, Photo, colours_of
from .prepare import channel_weights, depth_nodes, fewer_nodes
from .sensor import automatic_exposure, record, sensor_effects
from .terms import TermBlurring

GLARE_NODES = 8
"""Depths at which truncated light is known, for each node of band-limited PSFs: between them it is linear."""


@own_precision
def capture(
    views: View | Sequence[View],
    camera: Camera,
    fidelity: Fidelity | None = None,
    *,
    exposure: float | None = None,
    seed: int = 0,
    nodes: Tensor | None = None,
    spectrum: Tensor | None = None,
    layout: Layout | None = None,
    dtype: torch.dtype = torch.float32,
    device: torch.device | str = "cpu",
    cache: Path | None = None,
    progress: Progress | None = None,
    clock: Callable[[], float] = time.perf_counter,
) -> Photo:
    """Photograph views, simulating what `fidelity` says and nothing else.

    views: one, or several of one size and the same bands; the photo then has a batch axis in front, one
        exposure and one set of depth nodes for all, and the seeds seed, seed + 1, ...
    fidelity: None leaves nothing out that recipe and view hold (see `Fidelity`).
    exposure: factor from radiance to full scale, None for the camera's, which may be automatic (see
        `automatic_exposure`).
    seed: of the sensor's noise.
    nodes: [node] ascending inverse depths in 1/m.
    spectrum: [band], the light that groups of bands are weighted by, in place of the views' own: for a part
        of a view.
    layout: how a single view is composited, where that is known (`imaging.layout_within`).
    dtype: float32 or float64.
    cache: a folder for PSFs that outlive the process.
    clock: what the stages are timed by.
    camera: recipe, mask and sensor; its height map may carry gradients.
    device: that computes; the photo stays there.
    progress: is called with the part that is done, 0 to 1, and what is being done.

    Gradients reach the views' radiance and the camera's height map. The ideal image and the exposure always
    have all bands. A mask that absorbs light makes the exposure longer, not the photo darker: by
    1 / how["transmission"]. Raises InputError for a view that the camera cannot photograph.
    """
    watch = Stopwatch(progress, clock)
    fidelity = Fidelity() if fidelity is None else fidelity
    check_fidelity(fidelity)
    single = isinstance(views, View)
    given = [views] if isinstance(views, View) else list(views)
    distortion = _checked(given, camera, fidelity)
    given = [view.to(device, dtype) for view in given]
    weights = channel_weights(camera, given[0].wavelengths.cpu())
    ideal = torch.stack([view.crop_margin(all_in_focus(view, weights)) for view in given])
    factor = _exposure(exposure, camera, ideal, noisy=any(view.noise > 0 for view in given))
    depth = torch.stack([view.crop_margin(view.mean_inverse_depth()) for view in given]).detach()
    given = [as_composited(view, camera, fidelity) for view in given]
    axes = axes_of(given, camera, fidelity, weights, nodes, spectrum)
    watch.lap("prepare", 0.05)
    how = {"dtype": dtype, "device": device}
    photo, truncated, imaging, step = _imaged(
        given, camera, fidelity, axes, layout, factor, watch, cache, **how
    )
    clean = photo * factor
    effects = sensor_effects(camera, fidelity)
    image = torch.stack([record(each, effects, seed + k) for k, each in enumerate(clean)])
    said = How(
        distortion=distortion,
        field_step_px=step,
        sensor=[effect.model_dump() for effect in effects],
        seed=seed,
        **_used(given, camera, fidelity, axes, imaging),
    )
    watch.lap("sensor", 1.0)
    found = [image, clean, ideal * factor, truncated, depth]
    image, clean, ideal, truncated, depth = (each[0] for each in found) if single else found
    colours = colours_of(given, weights)
    return Photo(image, clean, ideal, factor, truncated, said, watch.seconds, depth, colours)


def _imaged(
    views: Sequence[View],
    camera: Camera,
    fidelity: Fidelity,
    axes: Axes,
    layout: Layout | None,
    exposure: float,
    watch: Stopwatch,
    cache: Path | None,
    dtype: torch.dtype,
    device: torch.device | str,
) -> tuple[Tensor, Tensor, Imaging, float | None]:
    """What the optics make of views: unexposed images [view, channel, y, x], the truncated fraction of their
    light [view, channel], the optics on the axis, and the pixels between the places in the field that have
    PSFs of their own, None where all have those of the axis."""
    frame = frame_of(views) if camera.lens.varies else None
    step = None if frame is None else field_step(camera, fidelity, frame, axes)
    how = {"dtype": dtype, "device": device}
    by_terms = step is not None and in_terms(camera, fidelity, device)
    tangent = None if step is None or by_terms else step * views[0].pixel_angle

    def optics(here: Camera) -> Imaging:
        # terms take the place of the axis's PSFs
        return imaging_of(here, fidelity, axes, field_step=tangent, held=not by_terms, cache=cache, **how)

    imaging = optics(camera)
    if frame is not None and step is not None and by_terms:
        tell = part_of(watch.progress, 0.05, 0.4)
        imaging = over_field(imaging, camera, axes, frame, step, cache=cache, progress=tell)
    watch.lap("psf", 0.4)
    lights = [imaging.light(view) for view in views]
    layouts = [imaging.layout(view) if layout is None else layout for view in views]
    unknown = [None] * len(views)  # of a part of the frame
    glare = [glare_of(light, imaging.blurring) for light in lights]

    def blurred(here: Camera, part: Part) -> Tensor:
        own = imaging if step is None or by_terms else optics(here)
        at, haze = own, glare if own is imaging else [glare_of(light, own.blurring) for light in lights]
        parts = (part(light, at.window // 2) for light in lights)
        known = layouts if here is camera else unknown
        images = [at.image(*each) for each in zip(parts, known, strict=True)]
        return torch.stack(images) + torch.stack([each for each, _ in haze])[:, :, None, None]

    def changed(here: Camera, part: Part) -> Tensor:
        at = sub_aperture_imaging(here, fidelity, axes, **how)
        parts = (part(at.light(view), at.window // 2) for view in views)
        known = layouts if here is camera else unknown
        return torch.stack([at.change_by_sub_apertures(*each) for each in zip(parts, known, strict=True)])

    photo = image_over_field(camera, frame, None if by_terms else step, blurred).to(views[0].radiance)
    watch.lap("blur", 0.5 if _in_parts(fidelity) else 0.9)
    if _in_parts(fidelity):
        photo = photo + change_over_field(camera, fidelity, frame, step, axes, exposure, changed).to(photo)
        watch.lap("sub_apertures", 0.9)
    return photo, torch.stack([fraction for _, fraction in glare]), imaging, step


def _in_parts(fidelity: Fidelity) -> bool:
    """Whether sub-apertures are simulated."""
    return fidelity.sub_apertures > 1 and fidelity.occlusion == "hidden"


def _used(views: Sequence[View], camera: Camera, fidelity: Fidelity, axes: Axes, imaging: Imaging) -> Json:
    """What a photo of views has used of what they, the camera and the fidelity hold, by fields of `How`."""
    return {
        "fidelity": values_of(fidelity),
        "layers": int(axes.nodes.numel()),
        "layers_db": fidelity.layers_db,
        "window_px": imaging.window,
        "margin_repeated_px": max(0, imaging.window // 2 - min(views[0].margin, imaging.reach)),
        "transmission": transmission(camera),
        "occlusion": fidelity.occlusion,
        "hidden_surfaces": _behind(views, fidelity),
        "guessed_fragments": sum(guessed_fragments(view) for view in views),
        "sub_apertures": fidelity.sub_apertures if _in_parts(fidelity) else 1,
        "bands": imaging.gathering.groups,
    }


@own_precision
def clean_photo(
    view: View,
    camera: Camera,
    fidelity: Fidelity,
    exposure: float,
    layout: Layout | None = None,
    weights: Tensor | None = None,
) -> Tensor:
    """The clean photo [channel, y, x] that `capture` makes of a view on the CPU in float32, and nothing else
    that a photo holds.

    weights: [channel, band], in place of the sensor's response.

    Raises InputError as that.
    """
    _checked([view], camera, fidelity)
    given, axes = _composited(view.to("cpu", torch.float32), camera, fidelity, weights)
    how = {"dtype": torch.float32, "device": "cpu"}
    found = _imaged([given], camera, fidelity, axes, layout, exposure, Stopwatch(), None, **how)
    return found[0][0] * exposure


@own_precision
def sub_aperture_change(
    view: View,
    camera: Camera,
    fidelity: Fidelity,
    exposure: float,
    layout: Layout | None = None,
    weights: Tensor | None = None,
) -> Tensor:
    """What sub-apertures change in `clean_photo`, [channel, y, x]; 0 for a fidelity that simulates none.

    weights: [channel, band], in place of the sensor's response.
    """
    if not _in_parts(fidelity):
        return torch.zeros(())
    given, axes = _composited(view, camera, fidelity, weights)
    imaging = sub_aperture_imaging(camera, fidelity, axes)
    return imaging.change_by_sub_apertures(imaging.light(given), layout) * exposure


def _composited(view: View, camera: Camera, fidelity: Fidelity, weights: Tensor | None) -> tuple[View, Axes]:
    """A view as it is composited, and what its photo shares."""
    view = as_composited(view, camera, fidelity)
    weights = channel_weights(camera, view.wavelengths) if weights is None else weights
    return view, axes_of([view], camera, fidelity, weights)


def axes_of(
    views: Sequence[View],
    camera: Camera,
    fidelity: Fidelity,
    weights: Tensor,
    nodes: Tensor | None = None,
    spectrum: Tensor | None = None,
) -> Axes:
    """Of a photo of views.

    weights: the response [channel, band].
    nodes: [node], 1/m, as in `capture`.
    spectrum: [band], as in `capture`.
    views, camera, fidelity: as of `capture`.
    """
    spectrums = [spectrum_of(view) for view in views] if spectrum is None else [spectrum]
    at, between = depths_of(views, camera, fidelity) if nodes is None else (nodes, None)
    light = torch.stack(spectrums).sum(0)
    return Axes(weights, views[0].wavelengths, light, _ends(views), at, between)


def as_composited(view: View, camera: Camera, fidelity: Fidelity) -> View:
    """The view with what a fidelity composites behind its edges: guessed where that is not known (see
    `with_guessed`), unless it leaves hidden surfaces out or takes another way."""
    return with_guessed(view, camera) if fidelity.uncovers else view


def _behind(views: Sequence[View], fidelity: Fidelity) -> str:
    """What a photo knows of behind edges: `rendered`, `guessed`, `none` (nothing is hidden), `missing` (it is
    not known, and no guess was asked for) or `not used` by this way to composite."""
    if fidelity.occlusion != "hidden":
        return "not used"
    if any(guessed_fragments(view) for view in views):
        return "guessed"
    if any(bool(view.hidden.any()) for view in views):
        return "rendered"
    unknown = any(lacks_hidden(view) for view in views)
    return "missing" if unknown and not fidelity.hidden_surfaces else "none"


def depths_of(views: Sequence[View], camera: Camera, fidelity: Fidelity) -> tuple[Tensor, BandLimit | None]:
    """The depth nodes [node] of a fidelity for views, ascending inverse depths in 1/m, and how light between
    them is blurred, as in `Axes`."""
    shortest = float(views[0].wavelengths.min())
    depths = torch.cat([view.inverse_depth for view in views])
    per_dioptre = defocus_per_dioptre(camera, shortest)
    nodes = depth_nodes(depths, fidelity.layers or "auto", per_dioptre, fidelity.layers_db)
    # layers that hide each other are at the nodes themselves
    if fidelity.layers is None and fidelity.occlusion in ("none", "hidden"):
        return fewer_nodes(nodes, camera, shortest, fidelity.layers_db)
    return nodes, None


def ideal_image(view: View, camera: Camera | None = None, exposure: float | None = None) -> Tensor:
    """The pinhole image under a camera's response, exposed: [channel, y, x] of the padded frame.

    camera: None for the paper's.
    exposure: factor, None for automatic.
    """
    camera = camera or Camera.from_recipe(CameraRecipe(name="paper"))
    image = all_in_focus(view, response(camera, view.wavelengths).to(view.radiance))
    if exposure is None:
        exposure = automatic_exposure(view.crop_margin(image), noisy=view.noise > 0)
    return image * exposure


def all_in_focus(view: View, weights: Tensor) -> Tensor:
    """Visible light through the response `weights` [channel, band]: [channel, y, x], padded, unexposed.

    weights: [channel, band].
    view: of the scene.
    """
    rows, columns = view.padded_shape
    light = weights.to(view.radiance) @ view.radiance
    if not view.one_each:
        which = seen(view)
        image = view.radiance.new_zeros(len(weights), rows * columns)
        light = image.index_add(1, view.pixel[which], light.index_select(1, which))
    return light.reshape(-1, rows, columns)


def glare_of(view: View, blurring: Blurring) -> tuple[Tensor, Tensor]:
    """What the visible light beyond the PSFs' windows becomes: veiling glare, the same all over the padded
    frame.

    Such light lands far from where it belongs, and what leaves the frame comes in from outside of it as well;
    so its mean is all that is known of it. Returns the glare, unexposed, and the truncated fraction of the
    light that it is made of, both [channel].
    """
    radiance, psfs, between, weights = view.radiance, blurring.psfs, blurring.between, blurring.response
    rows, columns = view.padded_shape
    if isinstance(blurring, TermBlurring):
        which = seen(view)
        total, glare = weights @ radiance.index_select(1, which).sum(1), blurring.lost(view, which)
        return glare / (rows * columns), glare / torch.where(total > 0, total, torch.ones_like(total))
    nodes = psfs.inverse_depths
    if between is not None:
        nodes = torch.linspace(float(nodes[0]), float(nodes[-1]), GLARE_NODES * len(nodes), dtype=nodes.dtype)
    if psfs.inverse_depths.numel() == 1:
        amount = (radiance @ (~view.hidden).to(radiance))[:, None]
    else:
        which = seen(view)
        cell, share = hat_weights(view.inverse_depth[which], nodes)
        light = radiance.index_select(1, which)
        amount = light.new_zeros(view.bands, nodes.numel())
        amount = amount.index_add(1, cell, light * (1 - share))
        amount = amount.index_add(1, (cell + 1).clamp_max(nodes.numel() - 1), light * share)
    rest = psfs.truncated.to(amount)
    if between is not None:
        beyond = (amount.T * (between.shares(nodes, psfs.inverse_depths).T.to(rest) @ rest)).sum(0)
    else:
        there = amount.any(0)
        beyond = (amount[:, there] * rest[there].T.contiguous()).sum(1)
    total = weights @ amount.sum(1)
    glare = weights @ beyond
    return glare / (rows * columns), glare / torch.where(total > 0, total, torch.ones_like(total))


def _ends(views: Sequence[View]) -> tuple[float, float]:
    ends = [view.inverse_depth.aminmax() for view in views if view.inverse_depth.numel()]
    return min((float(low) for low, _ in ends), default=0.0), max(
        (float(high) for _, high in ends), default=0.0
    )


def _checked(views: Sequence[View], camera: Camera, fidelity: Fidelity) -> str:
    """How view and camera agree in distortion. Raises InputError for views that cannot be photographed."""
    if not views:
        raise InputError("no view to photograph: give at least one")
    for view in views:
        check_pixel_angle(view, camera.pixel_angle)
    distortion = {distortion_of(view, camera) for view in views}
    first = views[0]
    for view in views[1:]:
        if view.padded_shape != first.padded_shape or not torch.equal(view.wavelengths, first.wavelengths):
            raise InputError(
                f"views of {first.padded_shape} and {view.padded_shape} pixels with {first.bands} and "
                f"{view.bands} bands cannot share a batch: photograph them one by one"
            )
    check_window(first, fidelity.window_px or camera.recipe.psf.window_px)
    return " and ".join(sorted(distortion))


def _exposure(exposure: float | None, camera: Camera, ideal: Tensor, noisy: bool) -> float:
    wanted = camera.recipe.sensor.exposure if exposure is None else exposure
    if wanted == "auto":
        return automatic_exposure(ideal, noisy=noisy)
    if not (isinstance(wanted, float | int) and math.isfinite(wanted) and wanted > 0):
        raise InputError(f"exposure {wanted!r}: give a positive factor from radiance to full scale")
    return float(wanted)
