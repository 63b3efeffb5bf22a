"""From what the main job made to its page."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

import torch

from ..optics import Camera
from ..record import machine, versions
from ..restore import channel_psfs
from .model import ImageScore, PlanRow, Psfs, RunReport
from .run_page import write_report

if TYPE_CHECKING:
    from ..pipeline import Run

PSF_DEPTHS_M = (0.5, 0.7, 1.0, 1.5, 3.0, math.inf)


def write_run_report(path: Path, result: Run) -> Path:
    """The page of a run, one file. Raises InputError where it cannot be written. Returns the path."""
    camera = result.optics
    height = result.checkpoint.height if result.checkpoint else None
    inverse_depths = torch.tensor([1 / depth for depth in PSF_DEPTHS_M])
    psfs = channel_psfs(camera, result.view.wavelengths, inverse_depths, height)
    scene, lens_alone = result.scene.recipe, result.lens_alone
    report = RunReport(
        title=scene.name,
        purpose=scene.purpose,
        camera=result.camera.recipe.name,
        ideal=result.photo.ideal,
        photo=result.photo.image,
        restored=result.restored,
        lens_alone=lens_alone.image,
        inverse_depth=result.view.crop_margin(result.view.mean_inverse_depth()),
        scores={name: ImageScore(whole, result.by_depth[name]) for name, whole in result.scores.items()},
        psfs=Psfs(psfs, PSF_DEPTHS_M, camera.pixel * 1e6),
        focus_m=scene_focus(camera),
        plan=tuple(
            PlanRow(d.effect, d.called_for, why=f"{d.chosen}: {d.why}") for d in result.plan.decisions
        ),
        seconds=result.seconds,
        peak_memory_mib=result.peak_memory_mib,
        recipes={item.path.name: item.text for item in (result.scene, result.camera)},
        command=f"edofsim run {result.scene.path} --camera {result.camera.path} --seed {result.seed}",
        facts=_facts(result),
        versions=versions(),
        machine=machine(),
        notes=tuple(result.view.metadata.get("notes", ())),
        restored_label=f"Restored ({result.restored_by})",
    )
    return write_report(path, report)


def scene_focus(camera: Camera) -> float:
    """The distance in metres that the camera's recipe focuses at."""
    return camera.recipe.focus.distance_m


def _facts(result: Run) -> dict[str, str]:
    view = result.view
    nm = view.wavelengths * 1e9
    return {
        "Bands": f"{view.bands}, {nm[0]:.0f} to {nm[-1]:.0f} nm",
        "Fragments": f"{view.pixel.numel()}, {int(view.hidden.sum())} of them hidden",
        "Render noise": f"{view.noise:.2%} of the band mean",
        "Read noise": f"{result.optics.read_noise:g} of full scale",
        "Seed": f"scene {result.scene.recipe.seed}, sensor {result.seed}",
    }
