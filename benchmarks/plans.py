"""Are plans worth it? The default plan, planning counted, against fixed fidelities and everything in full.

`python -m benchmarks.plans FOLDER [--json FILE] [PICTURE.toml...]` photographs shipped scenes, members of
families and pictures with depth maps (see `docs.studies.depth_pictures`) through three masks four ways: (a)
the default plan, looked at for the first time; (b) one fixed simplification for all, the cheapest found on
validation scenes (members of another seed) whose worst error there is no worse than that of plans; (c) the
same, found for each mask by itself; (d) everything in full. It prints errors and seconds of the processor on
one thread, and keeps what it measures in FOLDER: the same code goes on from there.
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
import shlex
import statistics
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from unittest.mock import patch

import torch
from torch import Tensor

from edofsim.capture import Fidelity, capture, full_fidelity
from edofsim.capture.guessed import with_guessed
from edofsim.core.threads import one_thread
from edofsim.experiments.kept import Kept, key_of
from edofsim.experiments.predictions import MASKS, SCENES, camera_of, small_version
from edofsim.optics import Camera
from edofsim.optics import cache as psf_memory
from edofsim.plan import Planner, plan_photo, planner_of, remember
from edofsim.plan.effect import Level
from edofsim.recipe import SceneRecipe, load_scene
from edofsim.record import record, write_record
from edofsim.render import render
from edofsim.render.view import View
from edofsim.scene.family import member

FRAME = (256, 192, 32)
"""Width, height and samples: the middles of frames. In smaller photos planning counts more."""
FAMILIES = Path(__file__).parents[1] / "scenes" / "families"
VALIDATION, VALIDATION_SEED = ("alley", "shelf", "thicket"), 902
MEMBERS_SEED = 906
"""Of one member of each family; nothing was chosen on them."""
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


@dataclass(frozen=True)
class Planned:
    """A default plan: PSNR of its photo, what was asked for, seconds of planning and of the photo."""

    db: float
    asked_db: float
    planning: float
    seconds: float


class Bench:
    """Photos of cases, measured once by the same code and kept. folder: where."""

    def __init__(self, folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._folder, self._kept = folder, Kept(folder / "measured.jsonl")

    def measured(self, case: Case, fidelity: Fidelity) -> tuple[float, float]:
        """PSNR against everything in full, and seconds of the processor."""
        key = key_of(scene=case.name, mask=case.mask, fidelity=repr(fidelity))
        found = self._kept.get(key)
        if found is None:
            db, seconds = self._photographed(case, fidelity)
            found = {"db": db, "seconds": seconds}
            self._kept.put(key, found)
        return found["db"], found["seconds"]

    def planned(self, case: Case) -> Planned:
        """The default plan."""
        key = key_of(scene=case.name, mask=case.mask)
        found = self._kept.get(key)
        if found is None:
            psf_memory.forget()
            with (
                tempfile.TemporaryDirectory() as empty,
                patch.object(remember, "_folder", lambda: Path(empty)),
            ):
                started = time.process_time()
                plan = plan_photo(case.view, case.camera, every_effect=False)
                taken = time.process_time() - started
            db, seconds = self.measured(case, plan.fidelity)
            found = {"db": db, "planning": taken, "seconds": seconds, "asked_db": plan.asked_db or 0.0}
            self._kept.put(key, found)
        return Planned(**found)

    def full(self, case: Case) -> float:
        """Seconds of everything in full."""
        return self._truth(case)[1]

    def _photographed(self, case: Case, fidelity: Fidelity) -> tuple[float, float]:
        truth, _ = self._truth(case)
        photo, seconds = _timed(case, fidelity)
        error = float((photo - truth).double().square().mean())
        return (-10 * math.log10(error) if error else math.inf), seconds

    def _truth(self, case: Case) -> tuple[Tensor, float]:
        path = self._folder / f"{case.name}-{case.mask}-{key_of()}.pt"
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


def cases_of(recipes: Sequence[tuple[SceneRecipe, Path]]) -> Iterator[Case]:
    """The middles of scenes, with the folders that their recipes lie in, through each mask."""
    for recipe, base in recipes:
        recipe = small_version(recipe, FRAME)
        for mask in MASKS:
            camera = camera_of(mask)
            seen = recipe.seen_at(camera.pixel_angle) if recipe.follows_camera else recipe
            yield Case(recipe.name, mask, with_guessed(render(seen, base), camera), camera)


def members(families: Sequence[str], seed: int) -> list[tuple[SceneRecipe, Path]]:
    """One member of each family."""
    loaded = [load_scene(str(FAMILIES / f"{name}.toml")) for name in families]
    return [(member(each.recipe, seed), each.base) for each in loaded]


def validated(bench: Bench, folder: Path) -> dict[str, dict[str, object]]:
    """The presets by mask, and that for `all`; kept."""
    path = folder / f"presets-{key_of()}.json"
    if path.is_file():
        return json.loads(path.read_text())["presets"]
    cases = list(cases_of(members(VALIDATION, VALIDATION_SEED)))
    worst = {(case.name, case.mask): bench.planned(case).db for case in cases}
    presets = {}
    for group in (*MASKS, "all"):
        own = [case for case in cases if group in (case.mask, "all")]
        limit = min(worst[case.name, case.mask] for case in own)
        presets[group] = cheapest_preset(bench, own, limit)
        print(f"# {group}: {presets[group]} within {limit:.1f} dB", file=sys.stderr, flush=True)
    path.write_text(json.dumps({"presets": presets}, indent=1))
    return presets


def figures_of(bench: Bench, case: Case, presets: Mapping[str, Preset]) -> dict[str, float]:
    """Of a case: `psnr_db`, `missed` (1 where it has less than was asked for) and `seconds` by simulation."""
    full = full_fidelity(case.camera, case.view)
    plan = bench.planned(case)
    of_all, of_mask = (bench.measured(case, fitted(presets[group], full)) for group in ("all", case.mask))
    db = {"plan": plan.db, "one_for_all": of_all[0], "one_a_mask": of_mask[0]}
    seconds = {"plan": plan.planning + plan.seconds, "planned_before": plan.seconds}
    seconds |= {"one_for_all": of_all[1], "one_a_mask": of_mask[1], "full": bench.full(case)}
    found = {f"psnr_db.{name}": value for name, value in db.items()}
    found |= {f"missed.{name}": float(value < plan.asked_db) for name, value in db.items()}
    found |= {f"seconds.{name}": value for name, value in seconds.items()}
    for way in ("one_for_all", "one_a_mask", "full"):
        found |= {f"times.{way}.{each}": seconds[way] / seconds[each] for each in ("plan", "planned_before")}
    return {f"{name}.{case.name}.{case.mask}": value for name, value in found.items()}


def main() -> None:
    """Print figures of each case, and of all."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.plans", description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("pictures", nargs="*")
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args()
    bench, found = Bench(asked.folder), {}
    shipped = [load_scene(name) for name in (*SCENES, *asked.pictures)]
    recipes = [(loaded.recipe, loaded.base) for loaded in shipped]
    recipes += members(sorted(path.stem for path in FAMILIES.glob("*.toml")), MEMBERS_SEED)
    with one_thread():
        presets = validated(bench, asked.folder)
        for case in cases_of(recipes):
            now = figures_of(bench, case, presets)
            print(*(f"{name}: {value:.3g}" for name, value in now.items()), sep="\n", flush=True)
            found |= now
    for group, preset in presets.items():
        print(f"{group}: {preset}")
        found |= {f"preset.{group}.{name}": float(str(value or 0)) for name, value in preset.items()}
    for name in ("missed", "seconds"):
        each = [key for key in found if key.startswith(f"{name}.")]
        for way in dict.fromkeys(key.split(".")[1] for key in each):
            found[f"{name}_in_all.{way}"] = sum(found[key] for key in each if key.split(".")[1] == way)
    for key in [key for key in found if "_in_all." in key]:
        print(f"{key}: {found[key]:.3g}")
    ratios = [tuple(key.split(".")[1:3]) for key in found if key.startswith("times.")]
    for way, plan in dict.fromkeys(ratios):
        values = [value for key, value in found.items() if key.startswith(f"times.{way}.{plan}.")]
        print(
            f"{way} takes {statistics.median(values):.2f} times as long as {plan} (median of {len(values)})"
        )
    if asked.json:
        typed = shlex.join(["python", "-m", "benchmarks.plans", *sys.argv[1:]])
        write_record(asked.json, record("plans", figures=found, typed=typed))


if __name__ == "__main__":
    main()
