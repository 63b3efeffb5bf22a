"""A photo as a plan says: `expose` step by step, with what is left out left out."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import torch
from torch import Tensor

from ..errors import InputError
from ..optics import Camera, defocus
from ..render.view import View
from . import Photo
from .band_groups import Gathering, every_band, gathered, gathered_kernels, gathered_view
from .blurring import Blurring
from .checks import check_pixel_angle, check_view, check_window
from .crop import crop, with_margin
from .fidelity import FULL_DB, Fidelity, in_parts, sensor_effects, simpler_camera
from .methods import METHODS
from .occlusion import OCCLUSIONS
from .occlusion.parts import change_in_parts
from .photograph import all_in_focus, veil_of
from .prepare import blur_per_dioptre, channel_weights, choose_nodes, kernels_of, kernels_of_parts
from .sensor import automatic_exposure, record

Progress = Callable[[float, str], None]


def photograph(
    view: View,
    camera: Camera,
    fidelity: Fidelity,
    *,
    exposure: float | None = None,
    seed: int = 0,
    nodes: Tensor | None = None,
    spectrum: Tensor | None = None,
    device: torch.device | str = "cpu",
    cache: Path | None = None,
    progress: Progress | None = None,
    clock: Callable[[], float] = time.perf_counter,
) -> Photo:
    """Photograph a view, simulating what `fidelity` says and nothing else.

    exposure, seed, device, cache, progress: as for `expose`. nodes: [node] ascending inverse depths
    in 1/m, and spectrum: [band], the light that groups of bands are weighted by, in place of the view's own:
    for a part of a view. clock: what the stages are timed by. The ideal image and the exposure always have
    all bands.

    Raises InputError for a view that the camera cannot photograph.
    """
    watch = _Watch(progress, clock)
    window = fidelity.window or camera.recipe.psf.window_px
    check_pixel_angle(view, camera.pixel_angle)
    view = view.to(device, torch.float32)
    weights = channel_weights(camera, view.wavelengths.cpu())
    ideal = view.crop_margin(all_in_focus(view, weights))
    factor = _exposure(exposure, camera, ideal)
    gathering = gathering_of(view, camera, weights, fidelity, spectrum)
    if nodes is None:
        nodes = nodes_of(view, camera, fidelity)
    # few groups are quicker to check and to cut than many bands; what is not finite stays so
    light = gathered_view(view, gathering) if fidelity.groups else view
    check_view(light)
    reach = window // 2 if fidelity.margin is None else min(fidelity.margin, window // 2)
    light = with_margin(with_part_of_margin(light, reach), window // 2)
    check_window(light, window)
    response = gathering.response.to(light.radiance)
    simpler = simpler_camera(camera, fidelity)
    watch.lap("prepare", 0.05)
    kernels = kernels_of(
        simpler, gathering.wavelengths, nodes, window, cache=cache, device=device
    )
    if fidelity.groups:
        kernels = gathered_kernels(kernels, gathering)
    watch.lap("psf", 0.4)

    blurring = Blurring(
        kernels,
        response,
        METHODS[fidelity.method],
        fidelity.tolerance_db,
        gap=1 / blur_per_dioptre(camera),
    )
    photo = light.crop_margin(OCCLUSIONS[fidelity.occlusion](light, blurring))
    veil, lost = veil_of(light, kernels, response)
    photo = photo + veil[:, None, None]
    parts = fidelity.pupil_parts if fidelity.occlusion == "hidden" else 1
    watch.lap("blur", 0.9 if parts == 1 else 0.5)
    if parts > 1:
        coarse = in_parts(fidelity)
        photo = photo + seen_in_parts(
            view, camera, coarse, some_nodes(nodes, coarse), weights, spectrum, device
        )
        watch.lap("parts", 0.9)
    clean = photo * factor
    image = record(clean, sensor_effects(camera, fidelity), seed)
    how = {
        "method": fidelity.method,
        "layers": int(nodes.numel()),
        "occlusion": fidelity.occlusion,
        "pupil_parts": parts,
        "bands": gathering.groups,
        "window_px": window,
        "tolerance_db": fidelity.tolerance_db,
        "sensor": sensor_effects(camera, fidelity),
        "seed": seed,
    }
    watch.lap("sensor", 1.0)
    return Photo(image, clean, ideal * factor, factor, lost, how, watch.seconds)


def seen_in_parts(
    view: View,
    camera: Camera,
    fidelity: Fidelity,
    nodes: Tensor,
    weights: Tensor,
    spectrum: Tensor | None = None,
    device: torch.device | str = "cpu",
) -> Tensor:
    """What changes in a photo where the pupil is composited in parts, [channel, y, x] of the frame.

    fidelity: as `in_parts` gives it; the rest as for `photograph`.
    """
    window = fidelity.window or camera.recipe.psf.window_px
    gathering = gathering_of(view, camera, weights, fidelity, spectrum)
    reach = window // 2 if fidelity.margin is None else min(fidelity.margin, window // 2)
    light = with_margin(with_part_of_margin(gathered_view(view, gathering), reach), window // 2)
    simpler = simpler_camera(camera, fidelity)
    how = {"device": device}
    kernels = kernels_of(simpler, gathering.wavelengths, nodes, window, **how)
    across = fidelity.pupil_parts
    parts = kernels_of_parts(simpler, gathering.wavelengths, nodes, window, across, **how)
    blurring = Blurring(
        gathered_kernels(kernels, gathering),
        gathering.response.to(light.radiance),
        METHODS[fidelity.method],
        gap=1 / blur_per_dioptre(camera),
    )
    held = [gathered_kernels(part, gathering) for part in parts]
    return light.crop_margin(change_in_parts(light, blurring, held))


def some_nodes(nodes: Tensor, fidelity: Fidelity) -> Tensor:
    """As many nodes [node] from the first to the last as a simulation has layers, or all where they are no
    more."""
    if fidelity.layers is None or nodes.numel() <= fidelity.layers:
        return nodes
    return torch.linspace(float(nodes[0]), float(nodes[-1]), fidelity.layers, dtype=nodes.dtype)


def nodes_of(view: View, camera: Camera, fidelity: Fidelity) -> Tensor:
    """The depth nodes [node] of a fidelity, ascending inverse depths in 1/m."""
    return choose_nodes(
        view.inverse_depth,
        view.coverage * ~view.hidden,
        camera,
        float(view.wavelengths.min()),
        fidelity.method,
        "auto" if fidelity.layers is None else fidelity.layers,
        FULL_DB,
    )


def gathering_of(
    view: View,
    camera: Camera,
    weights: Tensor,
    fidelity: Fidelity,
    spectrum: Tensor | None = None,
    ends: tuple[float, float] | None = None,
) -> Gathering:
    """How a simulation gathers a view's bands; weights: [channel, band], the sensor's response; spectrum,
    ends (farthest and nearest inverse depth): of the view that this is a part of."""
    wavelengths = view.wavelengths.cpu()
    if fidelity.groups == 0:
        return every_band(wavelengths, weights)
    spectrum = spectrum_of(view) if spectrum is None else spectrum
    ends = ends or (float(view.inverse_depth.min()), float(view.inverse_depth.max()))
    middle = sum(ends) / 2
    place = defocus(camera, wavelengths, middle)
    return gathered(wavelengths, weights, spectrum, place, fidelity.groups, fidelity.colours)


def spectrum_of(view: View) -> Tensor:
    """Light of the whole frame in each band, [band], float64."""
    return (view.radiance @ (~view.hidden).to(view.radiance)).double().cpu()


def with_part_of_margin(view: View, margin: int | None) -> View:
    """The view with no more margin than that; None for all of it."""
    if margin is None or margin >= view.margin:
        return view
    return crop(view, 0, 0, view.height, view.width, margin)


def _exposure(exposure: float | None, camera: Camera, ideal: Tensor) -> float:
    wanted = camera.recipe.sensor.exposure if exposure is None else exposure
    if wanted == "auto":
        return automatic_exposure(ideal)
    if not float(wanted) > 0:
        raise InputError(f"exposure {wanted!r}: give a positive factor from radiance to full scale")
    return float(wanted)


@dataclass
class _Watch:
    """Seconds of each stage, and its name to whoever shows progress."""

    progress: Progress | None
    clock: Callable[[], float]
    seconds: dict[str, float] = field(default_factory=dict)
    started: float = 0.0

    def __post_init__(self) -> None:
        self.started = self.clock()

    def lap(self, stage: str, fraction: float) -> None:
        now = self.clock()
        self.seconds[stage], self.started = now - self.started, now
        if self.progress:
            self.progress(fraction, stage)
