"""From what the main job made to its page."""

from __future__ import annotations

import math
import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from ..capture import Fidelity, capture
from ..capture.fidelity_file import values_of
from ..capture.noise import NoiseState
from ..core.shipped import typed_as
from ..core.threads import in_threads
from ..errors import InputError
from ..optics import Camera
from ..optics.grid import PupilGrid, disc_coverage
from ..optics.height import surface
from ..plan import Plan, overall
from ..record import machine, versions
from ..render.view import View
from ..restore.truth import SAID
from .model import ImageScore, PlanRow, Psfs, RunReport
from .plot import Plot
from .run_page import write_report

if TYPE_CHECKING:
    from ..pipeline import Run

SHOWN = 5
"""Distances whose PSFs are shown."""
FOCUSED = 6
"""Distances of the slider over depth, evenly spaced in dioptres."""
QUICK = Fidelity(
    band_groups=2,
    group_wavelengths=1,
    layers_db=40.0,
    read_noise=False,
    shot_noise=False,
)
"""How its pictures are simulated: with as many depth layers as the lens asks for, wherever it is focused."""
LEAST_DIOPTRES = 0.01
PICTURE = 250  # samples across the picture of the DOE


def write_run_report(path: Path, result: Run, cost: Plot | None = None) -> Path:
    """The page of a run, one file.

    cost: chart of what accuracy costs.

    Returns the path.

    Raises InputError where it cannot be written.
    """
    camera = result.optics
    height, width = _height_map(camera)
    count = len(result.psf_depths)  # nodes from far to near; the blur changes alike from one to the next
    shown = torch.linspace(0, count - 1, min(count, SHOWN)).round().long()
    depths_m = tuple(1 / each if each > 0 else math.inf for each in result.psf_depths[shown].tolist()[::-1])
    scene, lens_alone = result.scene.recipe, result.lens_alone
    report = RunReport(
        title=scene.name,
        purpose=scene.purpose,
        camera=result.camera.recipe.name,
        ideal=result.photo.ideal,
        photo=result.photo.image,
        restored=result.restored,
        lens_alone=lens_alone.image,
        wiener=result.wiener,
        inverse_depth=result.view.crop_margin(result.view.mean_inverse_depth()),
        scores={name: ImageScore(whole, result.by_depth[name]) for name, whole in result.scores.items()},
        noises=result.noises,
        psfs=Psfs(result.psfs[shown].flip(0), depths_m, camera.pixel * 1e6),
        height_m=height,
        mask_width_m=width,
        focus_m=camera.recipe.focus.distance_m,
        focused=_focused(result),
        plan=tuple(
            PlanRow(
                d.effect,
                d.called_for,
                error=None if d.error is None else overall(d.error),
                seconds=None if d.error is None else d.seconds,
                why=f"{d.chosen}{' (overruled)' if d.overruled else ''}: {d.why}" if d.chosen else d.why,
                lens_alone=alone.chosen,
            )
            for d, alone in zip(result.plan.decisions, result.plan_lens_alone.decisions, strict=True)
        ),
        target=_target(result.plan),
        fidelity=_fidelity(result.plan.fidelity),
        cost=cost,
        seconds=result.seconds,
        peak_memory_mib=result.peak_memory_mib,
        recipes={item.path.name: item.text for item in (result.scene, result.camera)},
        command=shlex.join(
            ["edofsim", "run", typed_as(result.scene.path), "--camera", typed_as(result.camera.path)]
            + ["--seed", str(result.seed)]
        ),
        facts=_facts(result),
        versions=versions(),
        machine=machine(),
        notes=_notes(result.view.metadata, result.noise.state),
        colours=result.photo.colours,
        restored_label=f"Restored ({result.restored_by.name})",
    )
    return write_report(path, report)


def _focused(result: Run) -> dict[float, Tensor]:
    """What the lens alone sees focused from near to far, [3, y, x] by distance, as exposed for the photo.

    Quickly: few groups of bands and layers. Without distances that cannot be focused at, or whose PSFs would
    take more samples than are allowed.
    """
    view = result.view
    how = QUICK.changed({"occlusion": "hidden" if bool(view.hidden.any()) else "normalised"})
    alone = result.optics.without_mask()

    def seen(dioptres: float) -> tuple[float, Tensor] | None:
        metres = 1 / max(dioptres, LEAST_DIOPTRES)
        try:
            photo = capture(view, refocused(alone, metres), how, exposure=result.photo.exposure)
        except InputError:
            return None
        return metres, photo.clean

    # each takes so little that side by side they are done sooner than one after another on all cores
    return dict(filter(None, in_threads(seen, _spaced(view, FOCUSED), torch.device("cpu"))))


def _spaced(view: View, count: int) -> list[float]:
    """Inverse depths in 1/m evenly from near to far, without the nearest and farthest hundredth of the view;
    one where all lies at one depth."""
    some = view.inverse_depth[:: max(1, view.inverse_depth.numel() // 10**6)]
    near, far = (float(some.quantile(share)) for share in (0.99, 0.01))
    if near - far < 1e-6:
        return [near]
    return [near + (far - near) * step / (count - 1) for step in range(count)]


def refocused(camera: Camera, metres: float) -> Camera:
    """A camera focused at another distance, whose pixels grow or shrink to see the same angle as before.

    Raises InputError for a distance that it cannot focus at."""
    recipe = camera.recipe.model_copy(
        update={"focus": camera.recipe.focus.model_copy(update={"distance_m": metres})}
    )
    moved = Camera.from_recipe(recipe, camera.base)
    pixel_um = recipe.sensor.pixel_um * moved.sensor_distance / camera.sensor_distance
    sensor = recipe.sensor.model_copy(update={"pixel_um": pixel_um})
    return Camera.from_recipe(recipe.model_copy(update={"sensor": sensor}), camera.base)


def _fidelity(fidelity: Fidelity) -> str:
    """All fields that differ from their defaults, a sentence."""
    usual = values_of(Fidelity())
    own = {name: value for name, value in values_of(fidelity).items() if value != usual[name]}
    said = ", ".join(f"{name} = {value}" for name, value in own.items())
    return f"Simulated with {said or 'the defaults of a fidelity'}; photo.exr and --json hold all of it."


def _target(plan: Plan) -> str:
    """What was asked for and what is predicted, in a sentence or two."""
    if plan.replayed:
        return f"{plan.summary()}."
    predicted = f"Predicted: {plan.error_db:.1f} dB in {sum(plan.seconds.values()):.2g} s."
    return " ".join(filter(None, (f"Asked for: {plan.target}.", predicted, plan.note)))


def _height_map(camera: Camera) -> tuple[Tensor | None, float | None]:
    """Height of the DOE inside the pupil, [y, x] in metres, NaN outside, and its width in metres; None for
    masks that only block light."""
    grid = PupilGrid(PICTURE, 2 * camera.aperture_radius / PICTURE, camera.aperture_radius)
    height = surface(camera, grid)
    if height is None:
        return None, None
    return height.where(disc_coverage(grid, grid.radius) > 0.5, math.nan), PICTURE * grid.pitch


def _notes(metadata: Mapping[str, object], noise: NoiseState) -> tuple[str, ...]:
    """What was guessed where the view does not know, and noise that is in the scores."""
    guesses = {"holes filled": "Holes of the depth map", "beyond the border": "Beyond the border"}
    known = tuple(f"{label}: {metadata[key]}." for key, label in guesses.items() if metadata.get(key))
    return (*known, f"Scores: {SAID[noise]}.") if noise == "included" else known


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
