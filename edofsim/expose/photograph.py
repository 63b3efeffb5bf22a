"""From a view and a camera to a photo."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Literal

import torch
from torch import Tensor

from ..errors import InputError
from ..optics import Camera, psf_bank
from ..optics import response as sensor_response
from ..recipe import CameraRecipe
from ..render.view import View
from .blurring import Blurring
from .checks import check_pixel_angle, check_view, check_window
from .crop import with_margin
from .kernels import HeldKernels, Kernels, StreamedKernels, depth_nodes
from .light import hat_weights, seen
from .methods import METHODS
from .occlusion import OCCLUSIONS
from .photo import Photo
from .resample import resampled
from .sensor import SensorEffects, automatic_exposure, record

Progress = Callable[[float, str], None]

BRUTE_DEPTHS = 475
"""The paper's 3D scene has 475 depths; brute force uses as many unless told otherwise."""
HELD_BYTES = 1 << 29
"""Largest PSF bank that is held in memory as a whole."""


def expose(
    view: View,
    camera: Camera,
    *,
    method: str = "auto",
    layers: int | Literal["auto"] = "auto",
    occlusion: str = "hidden",
    tolerance_db: float = 50.0,
    exposure: float | None = None,
    effects: SensorEffects | None = None,
    seed: int = 0,
    height: Tensor | None = None,
    window_px: int | None = None,
    resample: bool = False,
    dtype: torch.dtype = torch.float32,
    device: torch.device | str = "cpu",
    progress: Progress | None = None,
) -> Photo:
    """Photograph a view: the paper's Eq. `Forwardmodel` and `SensorImage`, and occlusion.

    method: `brute`, `layered`, `low_rank`, `constant`, or `auto`; layers: depth nodes, or "auto";
    occlusion: `none`, `over`, `normalised`, `hidden`; tolerance_db: PSNR against the layered photo that
    `low_rank` keeps; exposure: factor from radiance to full scale, None for the camera's (which may be
    automatic, see `automatic_exposure`); effects: of the sensor, None for the camera's; seed: of its noise;
    height: [n, n] height map of the mask in metres in place of the recipe's, gradients reach it;
    window_px: side of the PSFs, None for the camera's; resample: accept a view of another pixel angle.
    Raises InputError for a view that the camera cannot photograph.
    """
    seconds: dict[str, float] = {}
    started = time.perf_counter()

    def lap(stage: str, fraction: float) -> None:
        nonlocal started
        now = time.perf_counter()
        seconds[stage] = now - started
        started = now
        if progress:
            progress(fraction, stage)

    _known(method, ("auto", *METHODS), "method")
    _known(occlusion, OCCLUSIONS, "occlusion")
    check_view(view)
    if resample:
        view = resampled(view, camera.pixel_angle)
    check_pixel_angle(view, camera.pixel_angle)
    view = view.to(device, dtype)
    weights = sensor_response(camera, view.wavelengths).to(device, dtype)
    window = window_px or camera.recipe.psf.window_px
    check_window(view, window)
    wanted = with_margin(view, window // 2)
    added = wanted.margin - view.margin
    view = wanted
    lap("prepare", 0.05)

    nodes = choose_nodes(view, camera, method, layers)
    method = _choose_method(method, nodes)
    kernels = kernels_of(
        camera, view.wavelengths, nodes, window, height=height, seed=seed, dtype=dtype, device=device
    )
    lap("psf", 0.4)
    blur_px_per_dioptre = 2 * camera.aperture_radius * camera.sensor_distance / camera.pixel
    blurring = Blurring(kernels, weights, METHODS[method], tolerance_db, gap=1 / blur_px_per_dioptre)
    photo = view.crop_margin(OCCLUSIONS[occlusion](view, blurring))
    lap("blur", 0.9)

    ideal = view.crop_margin(all_in_focus(view, weights))
    factor = _exposure(exposure, camera, ideal)
    effects = effects or effects_of(camera)
    clean = photo * factor
    image = record(clean, effects, seed)
    how = {
        "method": method,
        "layers": int(nodes.numel()),
        "occlusion": occlusion,
        "bands": view.bands,
        "window_px": window,
        "tolerance_db": tolerance_db,
        "margin_repeated_px": added,
        "sensor": effects,
        "seed": seed,
    }
    lost = light_lost(view, kernels, weights)
    lap("sensor", 1.0)
    return Photo(image, clean, ideal * factor, factor, lost, how, seconds)


def ideal_image(view: View, camera: Camera | None = None, exposure: float | None = None) -> Tensor:
    """The pinhole image under a camera's response, exposed: [channel, y, x] of the padded frame.

    camera: None for the paper's; exposure: factor, None for automatic.
    """
    camera = camera or Camera.from_recipe(CameraRecipe(name="paper"))
    image = all_in_focus(view, sensor_response(camera, view.wavelengths).to(view.radiance))
    return image * (automatic_exposure(view.crop_margin(image)) if exposure is None else exposure)


def all_in_focus(view: View, weights: Tensor) -> Tensor:
    """Visible light through the response `weights` [channel, band]: [channel, y, x], padded, unexposed."""
    rows, columns = view.padded_shape
    which = seen(view)
    image = view.radiance.new_zeros(len(weights), rows * columns)
    return image.index_add(1, view.pixel[which], weights @ view.radiance[:, which]).reshape(-1, rows, columns)


def choose_nodes(view: View, camera: Camera, method: str, layers: int | str) -> Tensor:
    """Depth nodes [node] for a view, ascending inverse depths in 1/m."""
    depth = view.inverse_depth
    if method == "constant":
        weight = view.coverage.detach().double() * ~view.hidden
        return ((depth.detach().double() * weight).sum() / weight.sum().clamp_min(1e-300)).reshape(1)
    if method == "brute" and layers == "auto":
        layers = BRUTE_DEPTHS
    defocus = math.pi / float(view.wavelengths.min()) * camera.aperture_radius**2
    return depth_nodes(depth, layers, defocus)


def kernels_of(
    camera: Camera,
    wavelengths: Tensor,
    nodes: Tensor,
    window: int,
    *,
    height: Tensor | None = None,
    seed: int | None = None,
    dtype: torch.dtype = torch.float32,
    device: torch.device | str = "cpu",
) -> Kernels:
    """The camera's PSFs at depth nodes: held in memory where they fit, or where gradients must pass them."""

    def compute(depths: Tensor) -> Tensor:
        bank = psf_bank(
            camera,
            wavelengths,
            depths,
            window_px=window,
            height=height,
            seed=seed,
            dtype=dtype,
            device=device,
        )
        return bank.values

    size = nodes.numel() * wavelengths.numel() * window * window * torch.finfo(dtype).bits // 8
    if size <= HELD_BYTES or (height is not None and height.requires_grad):
        return HeldKernels(compute(nodes), nodes)
    return StreamedKernels(compute, nodes, window)


def light_lost(view: View, kernels: Kernels, weights: Tensor) -> Tensor:
    """Fraction of the visible light that lands outside the PSFs' windows, per channel [channel]."""
    which = seen(view)
    cell, share = hat_weights(view.inverse_depth[which], kernels.nodes)
    light = view.radiance.detach()[:, which]
    amount = light.new_zeros(view.bands, kernels.nodes.numel())
    amount.index_add_(1, cell, light * (1 - share))
    amount.index_add_(1, (cell + 1).clamp_max(kernels.nodes.numel() - 1), light * share)
    rest = torch.zeros_like(amount)
    for node in torch.nonzero(amount.any(0)).squeeze(1).tolist():
        rest[:, node] = kernels.rest(node).detach()
    total = (weights @ amount).sum(1)
    return (weights @ (amount * rest)).sum(1) / torch.where(total > 0, total, torch.ones_like(total))


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


def _exposure(exposure: float | None, camera: Camera, ideal: Tensor) -> float:
    wanted = camera.recipe.sensor.exposure if exposure is None else exposure
    if wanted == "auto":
        return automatic_exposure(ideal)
    if not (isinstance(wanted, float | int) and math.isfinite(wanted) and wanted > 0):
        raise InputError(f"exposure {wanted!r}: give a positive factor from radiance to full scale")
    return float(wanted)


def _choose_method(method: str, nodes: Tensor) -> str:
    if method != "auto":
        return method
    return "constant" if nodes.numel() == 1 else "layered"


def _known(name: str, names, what: str) -> None:
    if name not in names:
        raise InputError(f"{what} {name!r} is not known: choose one of {', '.join(names)}")
