"""From a view and a camera to a photo."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Literal

import torch
from torch import Tensor

from ..errors import InputError
from ..optics import Camera, response
from ..optics.precision import own_precision
from ..recipe import CameraRecipe
from ..render.view import View
from .blurring import Blurring
from .checks import check_pixel_angle, check_view, check_window
from .crop import with_margin
from .kernels import Kernels
from .light import hat_weights, seen
from .methods import METHODS
from .occlusion import OCCLUSIONS
from .photo import Photo
from .prepare import (
    blur_per_dioptre,
    channel_weights,
    choose_nodes,
    kernels_of,
    kernels_of_parts,
    transmission,
)
from .resample import resampled
from .sensor import SensorEffects, automatic_exposure, record

Progress = Callable[[float, str], None]


@own_precision
def expose(
    view: View | Sequence[View],
    camera: Camera,
    *,
    method: str = "auto",
    layers: int | Literal["auto"] = "auto",
    occlusion: str = "hidden",
    pupil_parts: int = 1,
    tolerance_db: float = 50.0,
    exposure: float | None = None,
    effects: SensorEffects | None = None,
    seed: int = 0,
    window_px: int | None = None,
    resample: bool = False,
    cache: Path | None = None,
    dtype: torch.dtype = torch.float32,
    device: torch.device | str = "cpu",
    progress: Progress | None = None,
) -> Photo:
    """Photograph a view: the paper's Eq. `Forwardmodel` and `SensorImage`, and occlusion.

    view: one, or several of one size and the same bands; the photo then has a batch axis in front, one
    exposure and one set of depth nodes for all, and the seeds seed, seed + 1, ...
    method: `brute`, `layered`, `low_rank`, `constant`, or `auto` (constant for one depth, layered where a
    height map is trained, else low_rank); layers: depth nodes, or "auto";
    occlusion: `none`, `over`, `normalised`, `hidden`; pupil_parts: along each axis, that `hidden` composites
    one by one (`optics.psf_parts`): truer where what hides and what is hidden are both blurred, at
    pupil_parts^2 times the cost at edges; tolerance_db: PSNR against the layered photo that
    `low_rank` keeps; exposure: factor from radiance to full scale, None for the camera's (which may be
    automatic, see `automatic_exposure`); effects: of the sensor, None for the camera's; seed: of its noise;
    window_px: side of the PSFs, None for the camera's; resample: accept a view of another pixel angle;
    cache: a folder for PSFs that outlive the process.

    A mask that absorbs light makes the exposure longer, not the photo darker: by 1 / how["transmission"].
    Raises InputError for a view that the camera cannot photograph.
    """
    watch = _Stopwatch(progress)
    _known(method, ("auto", *METHODS), "method")
    _known(occlusion, OCCLUSIONS, "occlusion")
    window = window_px or camera.recipe.psf.window_px
    single = isinstance(view, View)
    given = [view] if single else list(view)
    views = [_ready(each, camera, window, resample).to(device, dtype) for each in given]
    _same_size(views)
    weights = channel_weights(camera, views[0].wavelengths).to(device, dtype)
    watch.lap("prepare", 0.05)

    nodes = choose_nodes(
        torch.cat([each.inverse_depth for each in views]),
        torch.cat([each.coverage * ~each.hidden for each in views]),
        camera,
        float(views[0].wavelengths.min()),
        method,
        layers,
        tolerance_db,
    )
    if method == "auto":
        trained = camera.height_map is not None and camera.height_map.requires_grad
        method = "constant" if nodes.numel() == 1 else "layered" if trained else "low_rank"
    kernels = kernels_of(
        camera, views[0].wavelengths, nodes, window, cache=cache, dtype=dtype, device=device
    )
    watch.lap("psf", 0.4)
    parts = None
    if pupil_parts != 1 and occlusion == "hidden":
        parts = partial(
            kernels_of_parts,
            camera,
            views[0].wavelengths,
            nodes,
            window,
            pupil_parts,
            dtype=dtype,
            device=device,
        )
    gap = 1 / blur_per_dioptre(camera)
    # at worst, the errors of all pupil_parts^2 parts add up
    part_db = 40 * math.log10(max(1, pupil_parts))
    blurring = Blurring(kernels, weights, METHODS[method], tolerance_db, gap, parts, part_db)
    photo = torch.stack([each.crop_margin(OCCLUSIONS[occlusion](each, blurring)) for each in views])
    veils = [veil_of(each, kernels, weights) for each in views]
    photo = photo + torch.stack([veil for veil, _ in veils])[:, :, None, None]
    watch.lap("blur", 0.9)

    ideal = torch.stack([each.crop_margin(all_in_focus(each, weights)) for each in views])
    factor = _exposure(exposure, camera, ideal)
    effects = effects or effects_of(camera)
    clean = photo * factor
    image = torch.stack([record(each, effects, seed + k) for k, each in enumerate(clean)])
    lost = torch.stack([fraction for _, fraction in veils])
    how = {
        "method": method,
        "layers": int(nodes.numel()),
        "occlusion": occlusion,
        "pupil_parts": pupil_parts,
        "bands": views[0].bands,
        "window_px": window,
        "tolerance_db": tolerance_db,
        "margin_repeated_px": max(0, window // 2 - given[0].margin),
        "transmission": transmission(camera),
        "sensor": effects,
        "seed": seed,
    }
    watch.lap("sensor", 1.0)
    images = (image, clean, ideal * factor)
    if single:
        images, lost = tuple(each[0] for each in images), lost[0]
    return Photo(*images, factor, lost, how, watch.seconds)


def ideal_image(view: View, camera: Camera | None = None, exposure: float | None = None) -> Tensor:
    """The pinhole image under a camera's response, exposed: [channel, y, x] of the padded frame.

    camera: None for the paper's; exposure: factor, None for automatic.
    """
    camera = camera or Camera.from_recipe(CameraRecipe(name="paper"))
    image = all_in_focus(view, response(camera, view.wavelengths).to(view.radiance))
    return image * (automatic_exposure(view.crop_margin(image)) if exposure is None else exposure)


def all_in_focus(view: View, weights: Tensor) -> Tensor:
    """Visible light through the response `weights` [channel, band]: [channel, y, x], padded, unexposed."""
    rows, columns = view.padded_shape
    light = weights.to(view.radiance) @ view.radiance
    if not view.one_each:
        which = seen(view)
        image = view.radiance.new_zeros(len(weights), rows * columns)
        light = image.index_add(1, view.pixel[which], light.index_select(1, which))
    return light.reshape(-1, rows, columns)


def veil_of(view: View, kernels: Kernels, weights: Tensor) -> tuple[Tensor, Tensor]:
    """What the visible light beyond the PSFs' windows becomes: a veil, the same all over the padded frame.

    Such light lands far from where it belongs, and what leaves the frame comes in from outside of it as well;
    so its mean is all that is known of it. Returns the veil, unexposed, and the fraction of the light that it
    is made of, both [channel] under the response `weights` [channel, band].
    """
    radiance = view.radiance
    if kernels.nodes.numel() == 1:
        amount = (radiance @ (~view.hidden).to(radiance))[:, None]
    else:
        which = seen(view)
        cell, share = hat_weights(view.inverse_depth[which], kernels.nodes)
        light = radiance.index_select(1, which)
        amount = light.new_zeros(view.bands, kernels.nodes.numel())
        amount = amount.index_add(1, cell, light * (1 - share))
        amount = amount.index_add(1, (cell + 1).clamp_max(kernels.nodes.numel() - 1), light * share)
    there = torch.nonzero(amount.any(0)).squeeze(1)
    rest = [kernels.rest(node).to(amount) for node in there.tolist()]
    beyond = (amount[:, there] * torch.stack(rest, 1)).sum(1) if rest else torch.zeros_like(amount[:, 0])
    total = weights @ amount.sum(1)
    veil = weights @ beyond
    rows, columns = view.padded_shape
    return veil / (rows * columns), veil / torch.where(total > 0, total, torch.ones_like(total))


def effects_of(camera: Camera) -> SensorEffects:
    """What the camera's recipe says of its sensor."""
    sensor = camera.recipe.sensor
    return SensorEffects(
        saturation=sensor.saturation,
        full_well=sensor.full_well_electrons,
        read_noise=sensor.read_noise,
        bits=sensor.bits,
        bayer=sensor.bayer,
    )


@dataclass
class _Stopwatch:
    """Seconds of each stage, and its name to whoever shows progress."""

    progress: Progress | None
    seconds: dict[str, float] = field(default_factory=dict)
    started: float = field(default_factory=time.perf_counter)

    def lap(self, stage: str, fraction: float) -> None:
        now = time.perf_counter()
        self.seconds[stage], self.started = now - self.started, now
        if self.progress:
            self.progress(fraction, stage)


def _ready(view: View, camera: Camera, window: int, resample: bool) -> View:
    """A view that has been checked, with the camera's pixels and a margin that holds its blur."""
    check_view(view)
    if resample:
        view = resampled(view, camera.pixel_angle)
    check_pixel_angle(view, camera.pixel_angle)
    check_window(view, window)
    return with_margin(view, window // 2)


def _same_size(views: Sequence[View]) -> None:
    if not views:
        raise InputError("no view to photograph: give at least one")
    first = views[0]
    for view in views[1:]:
        if view.padded_shape != first.padded_shape or not torch.equal(view.wavelengths, first.wavelengths):
            raise InputError(
                f"views of {first.padded_shape} and {view.padded_shape} pixels with {first.bands} and "
                f"{view.bands} bands cannot share a batch: photograph them one by one"
            )


def _exposure(exposure: float | None, camera: Camera, ideal: Tensor) -> float:
    wanted = camera.recipe.sensor.exposure if exposure is None else exposure
    if wanted == "auto":
        return automatic_exposure(ideal)
    if not (isinstance(wanted, float | int) and math.isfinite(wanted) and wanted > 0):
        raise InputError(f"exposure {wanted!r}: give a positive factor from radiance to full scale")
    return float(wanted)


def _known(name: str, names: Iterable[str], what: str) -> None:
    if name not in names:
        raise InputError(f"{what} {name!r} is not known: choose one of {', '.join(names)}")
