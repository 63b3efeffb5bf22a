"""How fast a machine does each kind of work of a photo, in seconds of the processor on one thread.

`python -m docs.studies.photo_rates` photographs made-up views and prints what `edofsim.plan.rates.SHIPPED`
holds; it takes about a minute. `python -m docs.studies.photo_rates FOLDER` photographs members of families,
as `edofsim evaluate predictions` does, and prints what `TODAY` holds. The folder keeps what was measured.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
import torch
from scipy.optimize import nnls

from edofsim.capture.fidelity import Fidelity
from edofsim.capture.occlusion.slabs import cuts, hides
from edofsim.capture.photograph import capture, depths_of
from edofsim.capture.prepare import blur_per_dioptre
from edofsim.core.threads import one_thread
from edofsim.experiments import predictions
from edofsim.optics import Camera
from edofsim.optics import cache as psf_memory
from edofsim.optics.masks.cubic import CubicMask
from edofsim.plan import planner_of
from edofsim.plan.rates import PACE, Rates, paces
from edofsim.plan.shape import shape_of
from edofsim.plan.work import KINDS, STAGES, work_of
from edofsim.recipe import CameraRecipe
from edofsim.recipe.load import load_scene
from edofsim.record import machine
from edofsim.render import render
from edofsim.render.view import View
from edofsim.scene.family import in_place_of

RUNS = (
    Fidelity(band_groups=1, group_wavelengths=1, layers=1, occlusion="none"),
    Fidelity(band_groups=1, group_wavelengths=2, layers=12, occlusion="none"),
    Fidelity(band_groups=2, group_wavelengths=2, layers=5, occlusion="none", window_px=64),
    Fidelity(band_groups=0, layers=3, occlusion="none"),
    Fidelity(band_groups=0, layers=12, occlusion="none", window_px=32),
    Fidelity(band_groups=3, group_wavelengths=1, layers=6, occlusion="none", pupil_sampling_um=9.0),
    Fidelity(band_groups=1, group_wavelengths=0, layers=4, occlusion="none", oversampling=4),
    Fidelity(band_groups=2, group_wavelengths=2, layers=20, occlusion="none", window_px=16),
    Fidelity(band_groups=1, group_wavelengths=1, layers=6, occlusion="hidden"),
    Fidelity(band_groups=2, group_wavelengths=1, layers=10, occlusion="hidden", window_px=64),
    Fidelity(band_groups=3, group_wavelengths=1, layers=24, occlusion="hidden", window_px=32),
    Fidelity(band_groups=0, layers=2, occlusion="hidden", window_px=32),
    Fidelity(band_groups=1, group_wavelengths=2, layers=4, occlusion="normalised"),
    Fidelity(band_groups=3, group_wavelengths=1, layers=8, occlusion="normalised", window_px=48),
    Fidelity(band_groups=1, group_wavelengths=1, layers=4, occlusion="hidden", sub_apertures=3),
    Fidelity(band_groups=1, group_wavelengths=2, layers=9, occlusion="hidden", sub_apertures=4),
    Fidelity(band_groups=1, group_wavelengths=1, layers=6, occlusion="hidden", sub_apertures=4, window_px=48),
    Fidelity(
        band_groups=1,
        group_wavelengths=2,
        layers=2,
        occlusion="hidden",
        sub_apertures=5,
        pupil_sampling_um=9.0,
    ),
    Fidelity(band_groups=1, group_wavelengths=1, layers=7, occlusion="hidden", sub_apertures=6, window_px=64),
)
SUB_APERTURE_RUNS = tuple(
    Fidelity(
        band_groups=1,
        group_wavelengths=1,
        layers=layers,
        occlusion="hidden",
        sub_apertures=across,
        sub_aperture_pixel=side,
    )
    for across, side, layers in ((6, 1, 13), (4, 1, 6), (4, 2, 9), (6, 2, 9), (6, 2, 3), (4, 4, 9), (6, 4, 5))
)
FLAT_RUNS = (
    Fidelity(band_groups=1, group_wavelengths=1, layers=1, occlusion="none"),
    Fidelity(band_groups=1, group_wavelengths=2, layers=1, occlusion="none", window_px=64),
    Fidelity(band_groups=2, group_wavelengths=2, layers=1, occlusion="none", window_px=48),
    Fidelity(band_groups=3, group_wavelengths=0, layers=1, occlusion="none", window_px=32),
    Fidelity(band_groups=0, layers=1, occlusion="none"),
)
FAMILIES, SEED = ("alley", "shelf", "thicket"), 902
"""Members for validation, and what draws them."""
MAP_SAMPLES = 240
"""Across a height map in the mask's place."""
LEAST_S = 0.002
"""Stages of members that take less say little."""
SIZES = ((96, 96), (288, 256))
"""Rows and columns of the views with depths; the larger one is composited in tiles where PSFs are small."""


def measure(repeats: int = 2) -> Rates:
    """Photograph made-up views in several ways, and solve for the seconds of each kind of work. Errors are
    relative, so that short stages are met as well as long ones."""
    with one_thread():
        return _one_thread_rates(Camera.from_recipe(CameraRecipe(name="rates")), repeats)


def _fastest(
    view: View,
    camera: Camera,
    run: Fidelity,
    repeats: int,
    clock: Callable[[], float],
) -> dict[str, float]:
    found = []
    for _ in range(repeats):
        psf_memory.forget()
        found.append(capture(view, camera, run, clock=clock).seconds)
    return {stage: min(each.get(stage, 0.0) for each in found) for stage in STAGES}


def _one_thread_rates(camera: Camera, repeats: int) -> Rates:
    rows: dict[str, list[tuple[float, ...]]] = {stage: [] for stage in STAGES}
    times: dict[str, list[float]] = {stage: [] for stage in STAGES}
    moments: list[Mapping[str, float]] = []
    small, large = (_made_up(*size, camera) for size in SIZES)
    flat = _made_up(160, 192, camera, flat=True)
    cubic = Camera.from_recipe(camera.recipe.model_copy(update={"mask": CubicMask()}))
    draw = torch.Generator().manual_seed(0)
    height_map = 1e-6 * torch.rand(MAP_SAMPLES, MAP_SAMPLES, generator=draw, dtype=torch.float64)
    for view, with_mask, runs, times_each in (
        (small, camera, RUNS, repeats),
        (flat, camera, FLAT_RUNS, repeats),
        (flat, cubic, FLAT_RUNS[1::2], repeats),
        (flat, camera.with_height(height_map), FLAT_RUNS[::2], repeats),
        (large, camera, RUNS[::3], 1),
        (small, cubic, SUB_APERTURE_RUNS, 1),
        (large, camera.with_height(height_map), SUB_APERTURE_RUNS, 1),
    ):
        gap = 1 / blur_per_dioptre(with_mask)
        hidden = hides(view, gap)
        shape = shape_of(view, with_mask, hidden, cuts(view, gap, hidden))
        for run in runs:
            found = _fastest(view, with_mask, run, times_each, time.process_time)
            moments.append(paces())
            layers = int(depths_of([view], with_mask, run)[0].numel())
            groups = 3 * run.band_groups or view.bands
            colours = (
                groups * max(run.group_wavelengths, 1)
                if run.band_groups and run.group_wavelengths
                else view.bands
            )
            work = work_of(shape, with_mask, run, layers, groups, colours)
            for stage in STAGES:
                if any(work.amounts[stage].values()):
                    rows[stage].append(tuple(work.amounts[stage].get(kind, 0.0) for kind in KINDS))
                    times[stage].append(found[stage] / sum(moments[-1].values()))
    psf_memory.forget()
    usual = {kind: min(each[kind] for each in moments) for kind in KINDS}
    return _rates(rows, times, usual)


def of_members(folder: Path) -> Rates:
    """Photos of `FAMILIES` by all masks at all targets, with everything in full and without each effect.

    folder: keeps what was measured, and is gone on from.
    """
    rows: dict[str, list[tuple[float, ...]]] = {stage: [] for stage in STAGES}
    times: dict[str, list[float]] = {stage: [] for stage in STAGES}
    scenes = in_place_of([load_scene(f"scenes/families/{name}.toml") for name in FAMILIES], 1, SEED)
    with one_thread():
        usual = paces()
    for outcome in predictions.measure(folder, print, scenes, quick=True):
        scene = next(each for each in scenes if each.recipe.name == outcome.scene)
        view = render(predictions.small_version(scene.recipe), scene.base)
        costs = planner_of(view, predictions.camera_of(outcome.mask)).costs
        for row in outcome.rows:
            for stage, amounts in costs.work(row.case.fidelity).amounts.items():
                if row.stages.get(stage, 0.0) >= LEAST_S:
                    rows[stage].append(tuple(amounts.get(kind, 0.0) for kind in KINDS))
                    times[stage].append(row.stages[stage] / row.pace)
    return _rates(rows, times, usual)


def _rates(
    rows: Mapping[str, Sequence[tuple[float, ...]]],
    times: Mapping[str, Sequence[float]],
    usual: Mapping[str, float],
) -> Rates:
    """rows: amounts of each stage by `KINDS`; times: seconds of these over the pace; usual: the pace."""
    solved = {
        stage: _solved(np.array(rows[stage]), np.array(times[stage])) for stage in STAGES if times[stage]
    }
    found = {
        stage: {kind: sum(usual.values()) * each for kind, each in zip(KINDS, each_kind, strict=True) if each}
        for stage, each_kind in solved.items()
    }
    return {**found, PACE: usual}


def _solved(rows: np.ndarray, seconds: np.ndarray) -> tuple[float, ...]:
    scale = np.maximum(np.abs(rows).max(0), 1e-30)
    seconds = np.maximum(seconds, 1e-4)
    found, _ = nnls(rows / scale / seconds[:, None], np.ones(len(rows)))
    return tuple((found / scale).tolist())


def _made_up(height: int, width: int, camera: Camera, flat: bool = False) -> View:
    """Noise at many depths, a square of it in front of the rest and hiding it, near the top left corner;
    flat: all at one depth in focus."""
    margin, bands = 64, 31
    rows, columns = height + 2 * margin, width + 2 * margin
    draw = torch.Generator().manual_seed(0)
    row, column = torch.meshgrid(torch.arange(rows), torch.arange(columns), indexing="ij")
    front = (not flat) & ((row - margin - 32).abs() < 24) & ((column - margin - 32).abs() < 24)
    depth = torch.rand(rows * columns, generator=draw)
    if flat:
        depth = torch.full_like(depth, 1 / camera.recipe.focus.distance_m)
    behind = torch.nonzero(front.flatten()).squeeze(1)
    depth[behind] = 1.5 + 0.5 * depth[behind]
    pixel = torch.cat([torch.arange(rows * columns), behind])
    inverse_depth = torch.cat([depth, torch.rand(len(behind), generator=draw)])
    hidden = torch.arange(len(pixel)) >= rows * columns
    order = torch.argsort(pixel * 2 + hidden)
    return View(
        height=height,
        width=width,
        margin=margin,
        pixel=pixel[order],
        coverage=torch.ones(len(pixel)),
        inverse_depth=inverse_depth[order],
        radiance=torch.rand(bands, len(pixel), generator=draw)[:, order],
        hidden=hidden[order],
        wavelengths=torch.linspace(420e-9, 720e-9, bands, dtype=torch.float64),
        pixel_angle=camera.pixel_angle,
    )


if __name__ == "__main__":
    print(f"# {machine()['processor']}, torch {torch.__version__}")
    print(json.dumps(of_members(Path(sys.argv[1])) if sys.argv[1:] else measure(), indent=1))
