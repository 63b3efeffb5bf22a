"""Are plans right? What they predict next to what is measured, over scenes and masks.

For each scene and mask: every effect left out in turn, and the accuracies that are promised, against the full
simulation. Counted are the effects that matter (measured below `MATTERS_DB`). Times are seconds of the
processor, all on one thread, at the pace that the machine's rates were measured at: a machine that has other
work at the same time does not fool them.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import typer

from .. import completion
from ..capture import capture
from ..core.progress import Progress
from ..core.threads import one_thread
from ..errors import InputError
from ..optics import Camera
from ..options import CacheOption, MembersOption, ShippedScenes
from ..plan import (
    Fidelity,
    decibels,
    overall,
    planner_of,
    rates,
    seen_in_thumbnails,
    simpler_recipe,
)
from ..recipe import Loaded, SceneRecipe, load_camera, load_scene
from ..record import machine
from ..render import render
from ..render.view import View
from ..report import Column, Table
from ..restore.checkpoint import load_checkpoint
from ..restore.scores import psnr
from ..scene.family import in_place_of
from . import cost
from .cost_scores import Judge, restoring
from .experiment import Findings, in_parts
from .kept import Kept, key_of

SCENES = (
    "wall",
    "clouds",
    "bench",
    "charts",
    "hallway",
    "desk",
    "stilllife",
    "night",
    "clutter",
    "foliage",
    "motorcycle",
)
MASKS = ("clear", "cubic", "learned")
LEARNED = "paper-dcnn"
TARGETS_DB = (30, 35, 40, 45, 50, 55)
MATTERS_DB = 60.0
RESTORED = "restored"
QUICK = (160, 128, 16)
"""Width, height and samples of the small versions: the middle of the frame, pixel for pixel."""


@dataclass(frozen=True)
class Outcome:
    """One scene and mask."""

    scene: str
    mask: str
    rows: tuple[cost.Measured, ...]


def small_version(recipe: SceneRecipe, size: tuple[int, int, int] = QUICK) -> SceneRecipe:
    """The middle of a scene's frame with few samples."""
    width, height, samples = size
    frame = {
        "width_px": min(width, recipe.frame.width_px),
        "height_px": min(height, recipe.frame.height_px),
    }
    return recipe.model_copy(
        update={
            "frame": recipe.frame.model_copy(update=frame),
            "render": recipe.render.model_copy(update={"samples": min(samples, recipe.render.samples)}),
        }
    )


@in_parts("scenes", lambda options: SCENES)
def run(
    folder: Path,
    progress: Progress,
    scenes: ShippedScenes = None,
    members: MembersOption = 0,
    first: Annotated[int, typer.Option("--seed", help="Seed of the first member.")] = 0,
    masks: Annotated[
        list[str] | None,
        typer.Option(
            "--mask",
            help=f"{', '.join(MASKS)}; repeatable; default all.",
            autocompletion=completion.one_of(*MASKS),
        ),
    ] = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="Use the middle of each frame and few samples.")
    ] = False,
    cache: CacheOption = None,
) -> Findings:
    """Compare plans with measurements.

    Predicted and measured error and time, over scenes and three masks (clear, cubic, learned), on one thread.
    The same command resumes interrupted work.

    Figures: pairs, share.{error_within_3_db,targets_met,time_within_1.5,time_within_1.7},
    worst_{optimism,pessimism}_db,
    worst_target_missed_db, share.score_within_{0.15,0.3}_db, worst_score_shift_db (of the restored image, for
    `restored`), times_faster.SCENE.MASK (the default choice against everything in full),
    times_faster_score.SCENE.MASK (that for `restored`).
    """
    known = [load_scene(scene) for scene in scenes or SCENES]  # refused before any time is spent
    known = in_place_of(known, members, first)
    unknown = [mask for mask in masks or () if mask not in MASKS]
    if unknown:
        raise InputError(f"--mask {unknown[0]}: give one of {', '.join(MASKS)}")
    outcomes = measure(folder, progress, known, masks or MASKS, quick=quick, cache=cache)
    numbers = figures(outcomes)
    for case, head in (("chosen", "times_faster"), (cost.FOR, "times_faster_score")):
        numbers |= {f"{head}.{name}": value for name, value in saved(outcomes, case).items()}
    totals = Table((Column("figure"), Column("value", "", 3)), tuple(numbers.items()))
    return Findings(numbers, shown=[_table(outcomes), totals], outputs={"measurements": folder})


def measure(
    folder: Path,
    progress: Progress,
    scenes: Sequence[Loaded[SceneRecipe]],
    masks: Sequence[str] = MASKS,
    *,
    quick: bool = False,
    cache: Path | None = None,
) -> list[Outcome]:
    """Every scene and mask, on one thread.

    folder: keeps what was measured, and is gone on from.
    quick: the scenes' small versions.
    """
    found = []
    jobs = [(scene, mask) for scene in scenes for mask in masks]
    for number, (scene, mask) in enumerate(jobs):
        name = scene.recipe.name
        progress(number / len(jobs), f"{name}, {mask}")
        recipe = small_version(scene.recipe) if quick else scene.recipe
        view = render(recipe, scene.base, cache=cache)
        camera = camera_of(mask)
        place = folder / f"{name}-{mask}"
        place.mkdir(parents=True, exist_ok=True)
        network = load_checkpoint(LEARNED, camera.recipe) if mask == "learned" else None
        restore = restoring(camera, view.wavelengths, view.inverse_depth, network)
        judge = Judge({RESTORED: restore})
        with one_thread():
            planner = planner_of(view, camera)
            cases = cost.cases_of(planner, TARGETS_DB)
            how = {"clock": time.process_time, "pace": rates.pace, "judge": judge}
            # what is behind edges is guessed once, for the plan
            rows = cost.measure(planner.facts.view, camera, cases, place, repeats=1, **how)
            usual = sum(rates.rates()[rates.PACE].values())
        paced = (replace(row, seconds=row.seconds * usual / row.pace) for row in rows)
        rendering = _rendering(recipe, scene.base, view, camera, place, cache)
        found.append(Outcome(name, mask, (*paced, *rendering)))
    return found


def _rendering(
    recipe: SceneRecipe,
    base: Path,
    view: View,
    camera: Camera,
    place: Path,
    cache: Path | None,
) -> list[cost.Measured]:
    """Effects of rendering left out: predicted from thumbnails, measured on the photo of another rendering.

    Seconds are not compared. None for a view that is not rendered here, or not with such effects. place:
    keeps what was measured.
    """
    changes = {}
    planner = planner_of(view, camera)
    shorter, plain = seen_in_thumbnails(replace(planner.facts, recipe=recipe), base, cache=cache)
    if 2 in shorter:
        changes["interreflection"] = (Fidelity(bounces=2), shorter[2])
    if plain:
        changes["dispersion of scene glass"] = (Fidelity(scene_dispersion=False), plain)
    kept = Kept(place / "rendering.jsonl")
    rows: list[cost.Measured] = []
    for name, (change, error) in changes.items():
        key = key_of(effect=name, recipe=recipe.model_dump(mode="json"), machine=machine())
        known = kept.get(key)
        if known is None:
            without = render(simpler_recipe(recipe, change), base, cache=cache)
            plan = planner.plan().fidelity
            truth = capture(view, camera, plan)
            other = capture(without, camera, plan, exposure=truth.exposure)
            known = {"psnr_db": psnr(other.clean, truth.clean)}
            kept.put(key, known)
        case = cost.Case(name, "without", change, predicted_db=decibels(overall(error)))
        rows.append(cost.Measured(case, known["psnr_db"], 0.0))
    return rows


def camera_of(mask: str) -> Camera:
    """The paper's camera with a mask of `MASKS`."""
    loaded = load_camera("paper-cubic" if mask == "cubic" else "paper-clear")
    camera = Camera.from_recipe(loaded.recipe, loaded.base)
    return camera.with_height(load_checkpoint(LEARNED, loaded.recipe).height) if mask == "learned" else camera


def figures(outcomes: Sequence[Outcome]) -> dict[str, float]:
    """How often plans were right, flat; shares are between 0 and 1."""
    pairs = [
        row
        for outcome in outcomes
        for row in outcome.rows
        if row.case.kind == "without" and row.measured_db < MATTERS_DB
    ]
    targets = [row for outcome in outcomes for row in outcome.rows if row.case.kind == "target"]
    timed = [row for outcome in outcomes for row in outcome.rows]
    off = [row.case.predicted_db - row.measured_db for row in pairs]
    missed = [row.case.asked_db - row.measured_db for row in targets]
    moved = [
        abs(row.shifts[RESTORED].mean)
        for row in timed
        if row.case.name == cost.FOR and RESTORED in row.shifts
    ]
    ratios = [row.case.predicted_seconds / row.seconds for row in timed if row.seconds > 0]
    return {
        "pairs": float(len(pairs)),
        "share.error_within_3_db": _share(abs(value) <= 3 for value in off),
        "worst_optimism_db": max(off, default=math.nan),
        "worst_pessimism_db": -min(off, default=math.nan),
        "share.targets_met": _share(value <= 1 for value in missed),
        "worst_target_missed_db": max(missed, default=math.nan),
        "share.score_within_0.15_db": _share(value <= 0.15 for value in moved),
        "share.score_within_0.3_db": _share(value <= 0.3 for value in moved),
        "worst_score_shift_db": max(moved, default=math.nan),
        "share.time_within_1.5": _share(1 / 1.5 <= ratio <= 1.5 for ratio in ratios),
        "share.time_within_1.7": _share(1 / 1.7 <= ratio <= 1.7 for ratio in ratios),
    }


def saved(outcomes: Sequence[Outcome], case: str = "chosen") -> Mapping[str, float]:
    """How many times as fast as the full fidelity the default choice, or another case, is, by scene and
    mask."""
    found = {}
    for outcome in outcomes:
        by_name = {row.case.name: row for row in outcome.rows}
        if case in by_name:
            found[f"{outcome.scene}.{outcome.mask}"] = by_name["full"].seconds / by_name[case].seconds
    return found


def _share(of: Iterable[bool]) -> float:
    answers = list(of)
    return sum(answers) / len(answers) if answers else math.nan


def _table(outcomes: Sequence[Outcome]) -> Table:
    """Effects that matter and targets: measured next to predicted."""
    names = (
        ("PSNR", "dB", 1),
        ("predicted", "dB", 1),
        ("restored shifts", "dB", 3),
        ("time", "s", 2),
        ("predicted", "s", 2),
    )
    columns = (*map(Column, ("scene", "mask", "case")), *(Column(*each) for each in names))
    rows = tuple(
        (
            outcome.scene,
            outcome.mask,
            f"{row.case.kind} {row.case.name}",
            row.measured_db,
            row.case.predicted_db,
            row.shifts[RESTORED].mean if RESTORED in row.shifts else None,
            row.seconds,
            row.case.predicted_seconds,
        )
        for outcome in outcomes
        for row in outcome.rows
        if row.case.name == cost.FOR
        or (row.case.kind in ("without", "target") and row.measured_db < MATTERS_DB)
    )
    return Table(columns, rows)
