"""What a step of training costs: the share of the optics, and what bfloat16 saves and changes.

The paper's setting: patches of 300 px, batches of 4, a free mask at 21 um, the D-CNN. Photographs are those
of scikit-image, so that the benchmark runs anywhere. Times are the median of several steps, the optics timed
apart: its forward pass, and its backward pass from the gradient of the photo.
"""

from __future__ import annotations

import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch

from edofsim.core.progress import Progress
from edofsim.learn import train
from edofsim.learn.doe import maps_of
from edofsim.learn.setup import Setup, prepare
from edofsim.learn.trainer import draw_batch
from edofsim.learn.workers import Workers, choose_device
from edofsim.recipe.load import Loaded
from edofsim.recipe.train import TrainRecipe

REPEATS = 5


def run(
    *,
    patch_px: int = 300,
    short_steps: int = 200,
    short_patch_px: int = 96,
    device: str = "auto",
    progress: Progress | None = None,
) -> dict[str, float]:
    """Figures: learn.seconds_per_step.{float32,bfloat16}, learn.optics_share.{...} (0 to 1),
    learn.bfloat16_speedup, and after `short_steps` steps at `short_patch_px` the validation PSNR
    learn.psnr_db.{...} with learn.bfloat16_psnr_change_db."""
    where = choose_device(device)
    figures: dict[str, float] = {}
    precisions = ("float32", "bfloat16")
    for index, precision in enumerate(precisions):
        if progress:
            progress(index / 4, f"step in {precision}")
        setup = prepare(_recipe(patch_px, 1, precision), None, Workers(0, 1, where))
        whole, optics = step_seconds(setup)
        figures[f"learn.seconds_per_step.{precision}"] = whole
        figures[f"learn.optics_share.{precision}"] = optics / whole
    figures["learn.bfloat16_speedup"] = (
        figures["learn.seconds_per_step.float32"] / figures["learn.seconds_per_step.bfloat16"]
    )
    for index, precision in enumerate(precisions):
        if progress:
            progress(0.5 + index / 4, f"short training in {precision}")
        with tempfile.TemporaryDirectory() as folder:
            trained = train(_recipe(short_patch_px, short_steps, precision), Path(folder), device=device)
        figures[f"learn.psnr_db.{precision}"] = trained.figures["psnr_db.validation"]
    change = figures["learn.psnr_db.bfloat16"] - figures["learn.psnr_db.float32"]
    figures["learn.bfloat16_psnr_change_db"] = change
    return figures


def step_seconds(setup: Setup) -> tuple[float, float]:
    """(seconds of a whole step without the optimiser's update, seconds of its optics), medians."""
    system, workers = setup.system.train(), Workers(0, 1, setup.device)
    draw = draw_batch(setup, 0, workers)

    def whole() -> None:
        system.zero_grad(set_to_none=True)
        system(draw_batch(setup, 0, workers)).loss.backward()

    def optics() -> None:
        captured = draw.scenes.photograph(system.optics.with_mask(maps_of(system.mask)))
        outputs = captured.clean, captured.truncated
        torch.autograd.backward(outputs, (captured.ideal, captured.truncated.detach()))

    return _median_seconds(whole, setup.device), _median_seconds(optics, setup.device)


def _median_seconds(work: Callable[[], Any], device: torch.device) -> float:
    times = []
    for _ in range(REPEATS + 1):
        _wait(device)
        start = time.perf_counter()
        work()
        _wait(device)
        times.append(time.perf_counter() - start)
    return statistics.median(times[1:])  # the first prepares kernels and buffers


def _wait(device: torch.device) -> None:
    if device.type == "cuda":
        torch.cuda.synchronize(device)


def _recipe(patch_px: int, steps: int, precision: str) -> Loaded[TrainRecipe]:
    recipe = TrainRecipe.model_validate(
        {
            "name": "bench",
            "camera": "paper-clear",
            "seed": 1,
            "mask": {"kind": "height-map"},
            "psf": {"window_px": 96, "pupil_sampling_um": 21.0},
            "data": {"patch_px": patch_px, "validation_patches": 8, "sources": [{"kind": "packaged"}]},
            "optimiser": {"steps": steps, "batch": 4, "precision": precision},
        }
    )
    return Loaded(recipe, Path("bench.toml"), "")
