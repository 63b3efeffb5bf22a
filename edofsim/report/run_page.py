"""The page of a run: images, scores, depth, point spread functions, plan, times, how to repeat it."""

from __future__ import annotations

import math
import shlex
from collections.abc import Mapping, Sequence
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
from ..plan import Decision, Plan, overall
from ..record import machine, versions
from ..render.view import View
from ..restore.truth import SAID
from .figures import ImageScore, time_plot
from .figures_optics import height_plot, psf_plot
from .images_page import Shown, image_page
from .page import Block, Code, Column, Page, Pairs, Section, SideBySide, Sweep, Table, Text, write_page
from .pictures import Picture, picture
from .plot import Plot
from .words import decibels, distance, duration, number, significant

if TYPE_CHECKING:
    from ..pipeline import Run

SHOWN = 5
"""Distances whose PSFs are shown."""
FOCUSED = 6
"""Distances of the slider over depth, evenly spaced in dioptres."""
QUICK = Fidelity(
    band_groups=1,
    group_wavelengths=1,
    layers_db=40.0,
    read_noise=False,
    shot_noise=False,
)
"""How its pictures are simulated: with as many depth layers as the lens asks for, wherever it is focused."""
LEAST_DIOPTRES = 0.01
FOCUSED_PX = 640
"""Of the longer side of pictures focused elsewhere, of which there are many."""
PICTURE = 250  # samples across the picture of the DOE


def write_run_report(path: Path, result: Run, cost: Plot | None = None, options: Sequence[str] = ()) -> Path:
    """Write the page of a run as one HTML file and return its path.

    cost: chart of what accuracy costs.
    options: see `run_page`.

    Raises InputError where it cannot be written.
    """
    return write_page(path, run_page(result, _focused(result), cost, options))


def run_page(
    result: Run, focused: Mapping[float, Tensor], cost: Plot | None = None, options: Sequence[str] = ()
) -> Page:
    """The page of a run.

    focused: what the lens alone sees when it is focused elsewhere, [3, y, x] by distance in metres.
    cost: chart of what accuracy costs.
    options: of the command that makes the same run, in addition to its recipes and seed.
    """
    images = {"ideal": result.photo.ideal, "photo": result.photo.image, "restored": result.restored}
    if result.wiener is not None:
        images["wiener"] = result.wiener
    shown = Shown(
        title=result.scene.recipe.name,
        camera=result.camera.recipe.name,
        images={**images, "lens_alone": result.lens_alone.image},
        inverse_depth=result.view.crop_margin(result.view.mean_inverse_depth()),
        scores={name: ImageScore(whole, result.by_depth[name]) for name, whole in result.scores.items()},
        noises=result.noises,
        focus_m=result.optics.recipe.focus.distance_m,
        colours=result.photo.colours,
        restored_by=result.restored_by.name,
    )
    rest = [
        Section("Optics", _optics(result)),
        Section("Plan", _plan(result.plan, result.plan_lens_alone, cost)),
        Section("Time and memory", _cost(result)),
        Section("Reproduce", _reproduce(result, options)),
    ]
    notes = _notes(result.view.metadata, result.noise.state)
    focus = _focus(shown, focused)
    purpose = result.scene.recipe.purpose
    return image_page(shown, purpose, _facts(result), notes=notes, focus=focus, rest=rest)


def _focus(shown: Shown, focused: Mapping[float, Tensor]) -> tuple[Block, ...]:
    """The slider over depth."""

    def one(place: tuple[float, Tensor]) -> Picture:
        at = distance(place[0])
        said = f"{shown.title}, lens alone focused at {at}."
        return picture(place[1], at, said, gain=shown.gain, largest=FOCUSED_PX, colours=shown.colours)

    pictures = tuple(in_threads(one, list(focused.items()), torch.device("cpu")))
    caption = (
        f"{shown.camera} without its mask, focused from near to far: without noise, with one group of bands "
        "a channel and few depth layers."
    )
    return (Sweep(pictures, "Focused at", caption, "images-all"),) if pictures else ()


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


def _optics(result: Run) -> tuple[Block, ...]:
    """PSFs at some of the depths, and the mask where it has a height."""
    count = len(result.psf_depths)  # nodes from far to near; the blur changes alike from one to the next
    shown = torch.linspace(0, count - 1, min(count, SHOWN)).round().long().flip(0)
    depths_m = [1 / each if each > 0 else math.inf for each in result.psf_depths[shown].tolist()]
    psfs = psf_plot(result.psfs[shown], depths_m, result.optics.pixel * 1e6)
    height = _height_map(result.optics)
    return (psfs,) if height is None else (psfs, height_plot(*height))


def _height_map(camera: Camera) -> tuple[Tensor, float] | None:
    """Height of the DOE inside the pupil, [y, x] in metres, NaN outside, and its width in metres; None for
    masks that only block light."""
    grid = PupilGrid(PICTURE, 2 * camera.aperture_radius / PICTURE, camera.aperture_radius)
    height = surface(camera, grid)
    if height is None:
        return None
    return height.where(disc_coverage(grid, grid.radius) > 0.5, math.nan), PICTURE * grid.pitch


def _plan(plan: Plan, lens_alone: Plan, cost: Plot | None) -> tuple[Block, ...]:
    """The effects that were weighed; errors and times stand where the plan predicted any; what was
    simulated."""
    said = (Text(_target(plan)), Text(_fidelity(plan.fidelity)))
    every = plan.decisions
    if not every:
        return said
    caption = "Effects of light that were weighed before the photo was taken."
    columns: list[tuple[str, list[str | bool]]] = [
        ("Effect", [each.effect for each in every]),
        ("Simulated", [each.called_for for each in every]),
    ]
    if any(each.error is not None for each in every):
        errors = [None if each.error is None else overall(each.error) for each in every]
        columns.append(("Error if left out", [_error(each) for each in errors]))
        columns.append(("Time", [duration(None if e.error is None else e.seconds) for e in every]))
        caption += (
            " The error is the root mean square over the sensor image at full scale 1, below it as PSNR."
        )
    columns.append(("Why", [_why(each) for each in every]))
    alone = [each.chosen for each in lens_alone.decisions]
    if any(alone):
        columns.append(("Lens alone", [*alone]))
        caption += (
            " The photo through the lens alone has a plan of its own, with the choices of the last column; "
            "nothing is restored from it."
        )
    heads = tuple(Column(name) for name, _ in columns)
    rows = tuple(zip(*(cells for _, cells in columns), strict=True))
    table = Table(heads, rows, caption, wordy=True)
    chart = (cost,) if cost is not None else ()
    return (*said, table, *chart)


def _why(decision: Decision) -> str:
    overruled = " (overruled)" if decision.overruled else ""
    return f"{decision.chosen}{overruled}: {decision.why}" if decision.chosen else decision.why


def _error(value: float | None) -> str:
    if value is None or not math.isfinite(value) or value <= 0:
        return significant(value, 2)
    return f"{significant(value, 2)}\n{decibels(-20 * math.log10(value))}"


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


def _cost(result: Run) -> tuple[Block, ...]:
    known = {"total time": duration(sum(result.seconds.values()))}
    known["peak memory"] = f"{number(result.peak_memory_mib, 0)} MiB"
    own = {name: f"{value} GiB" if name == "memory_gib" else value for name, value in machine().items()}
    named = {"memory" if name == "memory_gib" else name.replace("_", " "): own[name] for name in own}
    return (SideBySide((time_plot(result.seconds), Pairs({**known, **named}))),)


def _reproduce(result: Run, options: Sequence[str]) -> tuple[Block, ...]:
    recipes = (result.scene, result.camera)
    command = ["edofsim", "run", typed_as(result.scene.path), "--camera", typed_as(result.camera.path)]
    blocks: list[Block] = [Code(shlex.join([*command, "--seed", str(result.seed), *options]))]
    blocks += [Code(each.text, each.path.name) for each in recipes]
    return (*blocks, Pairs(versions(), "Versions", closed=True))


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
        "Fragments": f"{view.pixel.numel():,}, {int(view.hidden.sum()):,} of them hidden",
        "Render noise": f"{view.noise:.2%} of the band mean",
        "Read noise": f"{result.optics.read_noise:g} of full scale",
        "Seed": f"scene {result.scene.recipe.seed}, sensor {result.seed}",
    }
