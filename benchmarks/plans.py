"""Are plans worth it? The default plan, planning counted, against fixed fidelities and everything in full.

`python -m benchmarks.plans FOLDER` photographs shipped scenes, members of families and pictures through three
masks four ways: (a) the default plan, looked at for the first time; (b) one fixed simplification for all, the
cheapest found on validation scenes (members of another seed) whose worst error there is no worse than that of
plans; (c) the same, found for each mask by itself; (d) everything in full. It prints a table of errors and
seconds of the processor on one thread, and keeps what it measures in FOLDER, to go on from there.
"""

from __future__ import annotations

import itertools
import json
import math
import statistics
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from unittest.mock import patch

import torch
from torch import Tensor

from edofsim.capture import Fidelity, capture, full_fidelity
from edofsim.core.threads import one_thread
from edofsim.experiments.kept import Kept
from edofsim.experiments.predictions import MASKS, SCENES, camera_of, small_version
from edofsim.optics import Camera
from edofsim.optics import cache as psf_memory
from edofsim.plan import Planner, plan_photo, planner_of, remember
from edofsim.plan.effect import Level
from edofsim.recipe import load_scene
from edofsim.render import render
from edofsim.render.view import View
from edofsim.scene.family import member

FRAME = (256, 192, 32)
"""Width, height and samples: the middles of frames. In smaller photos planning counts more."""
VALIDATION, VALIDATION_SEED = ("alley", "shelf", "thicket"), 902
MEMBERS, MEMBERS_SEED = ("blocks", "gallery", "lookout"), 904
PICTURES = tuple(f"docs/studies/pictures/{name}.toml" for name in ("aloe", "grove3", "tray"))
BANDS = ((1, 2), (1, 0), (2, 2), (2, 0), (3, 2), (4, 0))
LAYERS = (7, 9, 13, 17, 21, 25, 33)
PARTS = ((1, 1), (3, 4), (3, 2), (6, 2))
WINDOWS = (48, 64, 96, None)
PUPILS_UM = (16.0, 12.0, None)
MOST_TRIED = 12
NEAR_DB = 3.0
"""Candidates are tried whose predicted worst error is no more than this above the limit."""

Preset = Mapping[str, object]


@dataclass(frozen=True)
class Case:
    """One view through one mask."""

    name: str
    mask: str
    view: View
    camera: Camera


class Bench:
    """Photos of cases, measured once and kept. folder: where."""

    def __init__(self, folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._folder, self._kept = folder, Kept(folder / "measured.jsonl")

    def measured(self, case: Case, fidelity: Fidelity) -> tuple[float, float]:
        """PSNR against everything in full, and seconds of the processor."""
        return self._once(f"{case.name}|{case.mask}|{fidelity!r}", lambda: self._photographed(case, fidelity))

    def planned(self, case: Case) -> tuple[float, float, float]:
        """PSNR of the default plan, seconds of the processor of planning and of the photo."""
        key = f"{case.name}|{case.mask}|planned"
        found = self._kept.get(key)
        if found is None:
            with (
                tempfile.TemporaryDirectory() as empty,
                patch.object(remember, "_folder", lambda: Path(empty)),
            ):
                started = time.process_time()
                plan = plan_photo(case.view, case.camera, every_effect=False)
                taken = time.process_time() - started
            db, seconds = self.measured(case, plan.fidelity)
            found = {"db": db, "planning": taken, "seconds": seconds}
            self._kept.put(key, {**found, "asked": plan.asked_db})
        return found["db"], found["planning"], found["seconds"]

    def full(self, case: Case) -> float:
        """Seconds of everything in full."""
        return self._truth(case)[1]

    def _once(self, key: str, work: Callable[[], tuple[float, float]]) -> tuple[float, float]:
        found = self._kept.get(key)
        if found is None:
            db, seconds = work()
            found = {"db": db, "seconds": seconds}
            self._kept.put(key, found)
        return found["db"], found["seconds"]

    def _photographed(self, case: Case, fidelity: Fidelity) -> tuple[float, float]:
        truth, _ = self._truth(case)
        photo, seconds = _timed(case, fidelity)
        error = float((photo - truth).double().square().mean())
        return (-10 * math.log10(error) if error else math.inf), seconds

    def _truth(self, case: Case) -> tuple[Tensor, float]:
        path = self._folder / f"{case.name}-{case.mask}.pt"
        if not path.is_file():
            torch.save(_timed(case, full_fidelity(case.camera, case.view)), path)
        photo, seconds = torch.load(path)
        return photo, seconds


def _timed(case: Case, fidelity: Fidelity) -> tuple[Tensor, float]:
    psf_memory.forget()
    started = time.process_time()
    photo = capture(case.view, case.camera, fidelity).clean
    return photo, time.process_time() - started


def fitted(preset: Preset, full: Fidelity) -> Fidelity:
    """A fixed simplification of what a view and camera have."""
    parts = min(full.sub_apertures, int(str(preset["sub_apertures"])))
    return full.changed({**preset, "sub_apertures": parts})


def candidates() -> list[dict[str, object]]:
    """All fixed simplifications that are looked at."""
    found = []
    grid = itertools.product(BANDS, LAYERS, PARTS, WINDOWS, PUPILS_UM)
    for (groups, colours), layers, (across, side), window, pitch in grid:
        preset: dict[str, object] = {"band_groups": groups, "group_wavelengths": colours, "layers": layers}
        preset |= {"sub_apertures": across, "sub_aperture_pixel": side}
        preset |= {"window_px": window, "pupil_sampling_um": pitch}
        found.append(preset)
    return found


def predicted(planner: Planner, preset: Preset) -> float:
    """PSNR of a preset by a planner's estimates: of each effect the level that is nearest, coarser."""
    chosen = {}
    for row in planner.estimates.rows:
        level = row.full
        if row.effect.name == "bands":
            level = _same(row.levels, preset, ("band_groups", "group_wavelengths"), row.full)
        elif row.effect.name == "depth layers":
            level = _same(row.levels, preset, ("layers",), row.full)
        elif row.effect.name == "sub-apertures" and row.full:
            parts = min(planner.facts.full.sub_apertures, int(str(preset["sub_apertures"])))
            keys = ("sub_apertures",) if parts == 1 else ("sub_apertures", "sub_aperture_pixel")
            level = _same(row.levels, {**preset, "sub_apertures": parts}, keys, 0)
        elif row.effect.name == "PSF window":
            level = _same(row.levels, preset, ("window_px",), row.full)
        elif row.effect.name == "pupil sampling" and preset["pupil_sampling_um"] is not None:
            level = 0
        chosen[row.effect.name] = level
    error = planner.estimates.total(chosen)
    return -20 * math.log10(error) if error else math.inf


def _same(levels: Sequence[Level], preset: Preset, keys: Sequence[str], other: int) -> int:
    for number, level in enumerate(levels[:-1]):
        if all(level.change.get(key) == preset[key] for key in keys):
            return number
    return other


def cheapest_preset(bench: Bench, cases: Sequence[Case], limit_db: float) -> dict[str, object]:
    """The candidate of least work whose measured worst error on the cases is within the limit."""
    planners = [planner_of(case.view, case.camera) for case in cases]
    listed = []
    for preset in candidates():
        worst = min(predicted(planner, preset) for planner in planners)
        if worst >= limit_db - NEAR_DB:
            work = sum(p.costs.reference(fitted(preset, p.facts.full)) for p in planners)
            listed.append((work, preset))
    listed.sort(key=lambda each: each[0])
    print(f"# {len(listed)} candidates for {limit_db:.1f} dB", file=sys.stderr, flush=True)
    hardest = list(cases)
    tried, last = 0, 0.0
    for work, preset in listed:
        if tried and work < 1.04 * last and tried > MOST_TRIED // 2:
            continue
        tried, last = tried + 1, work
        for place, case in enumerate(hardest):
            db, _ = bench.measured(case, fitted(preset, full_fidelity(case.camera, case.view)))
            if db < limit_db:
                hardest.insert(0, hardest.pop(place))
                print(f"# {preset}: {db:.1f} dB, {case.name} {case.mask}", file=sys.stderr, flush=True)
                break
        else:
            return preset
    raise SystemExit("no candidate stays within the limit: try more")


def cases_of(names: Sequence[tuple[str, int | None]], masks: Sequence[str] = MASKS) -> Iterator[Case]:
    """Shipped scenes and recipes, or members of families by their seed."""
    for name, seed in names:
        path = f"scenes/families/{name}.toml" if seed is not None else name
        loaded = load_scene(path)
        recipe = loaded.recipe if seed is None else member(loaded.recipe, seed)
        recipe = small_version(recipe, FRAME)
        for mask in masks:
            camera = camera_of(mask)
            try:
                seen = recipe.seen_at(camera.pixel_angle) if recipe.follows_camera else recipe
                view = render(seen, loaded.base)
            except Exception as error:  # a picture that was not downloaded
                print(f"# left out {name}: {error}", file=sys.stderr)
                break
            yield Case(recipe.name, mask, view, camera)


def validated(bench: Bench, folder: Path) -> dict[str, dict[str, object]]:
    """The presets by mask, and that for `all`; kept."""
    path = folder / "presets.json"
    if path.is_file():
        return json.loads(path.read_text())["presets"]
    names = [(name, VALIDATION_SEED) for name in VALIDATION]
    cases = list(cases_of(names))
    worst = {(case.name, case.mask): bench.planned(case)[0] for case in cases}
    presets = {}
    for group in (*MASKS, "all"):
        own = [case for case in cases if group in (case.mask, "all")]
        limit = min(worst[case.name, case.mask] for case in own)
        presets[group] = cheapest_preset(bench, own, limit)
        print(f"# {group}: {presets[group]} within {limit:.1f} dB", file=sys.stderr, flush=True)
    path.write_text(json.dumps({"presets": presets}, indent=1))
    return presets


def main(folder: Path) -> None:
    """Print the table."""
    bench = Bench(folder)
    with one_thread():
        presets = validated(bench, folder)
        names = [(name, None) for name in (*SCENES, *PICTURES)] + [(f, MEMBERS_SEED) for f in MEMBERS]
        rows = []
        heads = ("scene", "mask", "plan / dB", "s", "planning / s", "one for all / dB", "s")
        heads += ("one a mask / dB", "s", "full / s")
        print("| " + " | ".join(heads) + " |")
        print("|---|---|---|---|---|---|---|---|---|---|")
        for case in cases_of(names):
            full = full_fidelity(case.camera, case.view)
            db, planning, seconds = bench.planned(case)
            fixed = bench.measured(case, fitted(presets["all"], full))
            own = bench.measured(case, fitted(presets[case.mask], full))
            whole = bench.full(case)
            rows.append((planning + seconds, seconds, fixed[1], own[1], whole, db, fixed[0], own[0]))
            cells = (db, planning + seconds, planning, *fixed, *own, whole)
            print(
                f"| {case.name} | {case.mask} | " + " | ".join(f"{cell:.2f}" for cell in cells) + " |",
                flush=True,
            )
    for name, column in (("one for all", 2), ("by mask", 3), ("full", 4)):
        for what, plan in (("planning counted", 0), ("planned before", 1)):
            ratios = [row[column] / row[plan] for row in rows]
            print(f"{name} takes {statistics.median(ratios):.2f} times as long as the plan, {what} (median)")
        print(
            f"  in all {sum(row[column] for row in rows):.0f} s against {sum(row[0] for row in rows):.0f} s"
        )
    for name, column in (("plan", 5), ("one for all", 6), ("by mask", 7)):
        print(f"worst error, {name}: {min(row[column] for row in rows):.1f} dB")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
