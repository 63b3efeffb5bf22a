"""What accuracy costs in time: a scene's photo at every target, with every effect left out, measured.

Errors are those of the noise-free photo against the full fidelity, in sensor units, as PSNR; seconds are
medians over repeats in which all cases take turns, so that what else the machine does meets them alike; or,
by another clock, those of the processor. Effects that depth edges are not needed for are left out where the
pupil is one part, and judged so. Every measurement is kept as it comes in, and the same call goes on from
there.
"""

from __future__ import annotations

import hashlib
import math
import statistics
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import torch
from safetensors.torch import load_file, save_file
from torch import Tensor

from ..capture import Photo, capture
from ..core.json_values import Json
from ..core.progress import Progress
from ..core.store import found, keep
from ..optics import Camera
from ..optics import cache as psf_memory
from ..plan import RESTORED, Fidelity, Plan, Planner, Target, as_accurate
from ..plan.work import STAGES
from ..record import machine, write_csv
from ..render.view import View
from ..restore.scores import psnr
from .cost_scores import Judge, Shift, shifts
from .kept import Kept, key_of

TARGETS_DB = (25, 30, 35, 40, 45, 50, 55, 60)
FOR = "restored"
"""The target of what is restored, as a case."""
FINE_DB = 60.0
"""Effects are left out one by one of the plan for this accuracy: left out of the full simulation they would
err the same, and take hours."""


@dataclass(frozen=True)
class Case:
    """One way to simulate the photo.

    kind: `target`, `chosen`, `without`, or `full`.
    asked_db: of targets.
    predicted_db, predicted_seconds: by the plan.
    one_part: simulated without sub-apertures, and judged against the full simulation without them.
    alone: how the photo through the lens alone is simulated, None for `fidelity`.
    """

    name: str
    kind: str
    fidelity: Fidelity
    asked_db: float = math.inf
    predicted_db: float = math.inf
    predicted_seconds: float = 0.0
    one_part: bool = False
    alone: Fidelity | None = None


@dataclass(frozen=True)
class Measured:
    """What a case came to: PSNR against the full simulation and median seconds, in all and by stage.

    pace: of the machine meanwhile, where it was asked for.
    shifts: of the scores of restored photos, where these were judged.
    """

    case: Case
    measured_db: float
    seconds: float
    stages: Mapping[str, float] = field(default_factory=dict)
    repeats: int = 1
    pace: float = 0.0
    shifts: Mapping[str, Shift] = field(default_factory=dict)


def cases_of(
    planner: Planner, targets: tuple[int, ...] = TARGETS_DB, alone: Planner | None = None
) -> list[Case]:
    """The sweep of targets, the default choice, that for a restored image, each effect left out in turn, and
    everything in full.

    alone: of the same view through the lens alone, whose photo has its own plan in each case; None where none
        is compared with.
    """

    def planned(by: Planner, target: Target, whole: tuple[str, ...] = ()) -> Plan:
        """whole: effects of which nothing may be left out."""
        full = {row.effect.name: row.full for row in by.estimates.rows}
        return by.plan(target, {name: full[name] for name in whole if name in full})

    def rival_of(target: Target, whole: tuple[str, ...] = ()) -> Fidelity | None:
        return None if alone is None else planned(alone, target, whole).fidelity

    def case_of(name: str, kind: str, target: Target) -> Case:
        plan = planner.plan(target)
        case = _case(name, kind, plan.fidelity, planner, plan.asked_db or math.inf, plan.error_db)
        return replace(case, alone=rival_of(as_accurate(plan, target)))

    cases = [case_of(f"{db} dB", "target", Target("db", db=float(db))) for db in targets]
    cases += [case_of("chosen", "chosen", Target()), case_of(FOR, "target", RESTORED)]
    fine, parts = Target("db", db=FINE_DB), ("sub-apertures",)
    finely, all_bands = (
        (planned(planner, fine, whole), rival_of(fine, whole)) for whole in (parts, (*parts, "bands"))
    )
    for row in planner.estimates.rows:
        stage = row.effect.stage
        if row.full == 0 or stage in ("render", "sensor"):
            continue
        error = row.errors[0]
        square = sum(e * e for e in error) / len(error)
        # what a plan may not leave out because gathered bands would suffer more is left out of all bands
        rest, rival = finely if row.levels[0].allowed else all_bands
        change = {**dict(row.levels[0].change), "hidden_surfaces": True}
        fidelity = rest.fidelity.changed(change)
        its_own = 10 ** (-rest.error_db / 20)  # is in the photo that is measured, too
        together = its_own if fidelity == rest.fidelity else math.hypot(square**0.5, its_own)
        predicted = -20 * math.log10(together) if together > 0 else math.inf
        # sub-apertures cost a composite each, and change nothing in what other effects do; without
        # occlusion or hidden surfaces there are none
        one_part = fidelity.sub_apertures > 1 and fidelity.occlusion == "hidden"
        if one_part:
            change["sub_apertures"] = 1
            fidelity = fidelity.changed(change)
        case = _case(row.effect.name, "without", fidelity, planner, math.inf, predicted)
        cases.append(replace(case, one_part=one_part, alone=rival and rival.changed(change)))
    case = _case("full", "full", planner.facts.full, planner, math.inf, math.inf)
    cases.append(replace(case, alone=rival_of(Target("full"))))
    return cases


def _case(name: str, kind: str, fidelity: Fidelity, planner: Planner, asked: float, predicted: float) -> Case:
    seconds = planner.seconds_of(fidelity)
    return Case(name, kind, fidelity, asked, predicted, sum(seconds[stage] for stage in STAGES))


def measure(
    view: View,
    camera: Camera,
    cases: list[Case],
    folder: Path,
    *,
    repeats: int = 3,
    device: str = "cpu",
    progress: Progress | None = None,
    clock: Callable[[], float] = time.perf_counter,
    pace: Callable[[], float] | None = None,
    judge: Judge | None = None,
) -> list[Measured]:
    """Photograph the view in every case, `repeats` times in turns; the full one only once or twice.

    folder: keeps what was measured, and is gone on from.
    clock: what the work is timed by.
    pace: what tells how fast the machine is just then, asked before and after each case.
    judge: what restores and scores the photos, None for no scores.
    """
    bench = _Bench(view, camera, Kept(folder / "measurements.jsonl"), device, clock, pace, judge)
    kept = bench.kept
    (case,) = [case for case in cases if case.kind == "full"]
    full = bench.reference(case, folder)
    whole, part = full, case
    if any(case.one_part for case in cases):
        undivided = {"sub_apertures": 1}
        one_part = case.fidelity.changed(undivided)
        rival = case.alone and case.alone.changed(undivided)
        part = replace(case, name="full, one part", fidelity=one_part, alone=rival)
        whole = bench.reference(part, folder)
    of_full, of_part = ((kept.get(bench.key(each, 0)) or {}).get("scores", {}) for each in (case, part))
    turns = [(turn, case) for turn in range(repeats) for case in cases if turn == 0 or case.kind != "full"]
    keys = {(turn, case): bench.key(case, turn) for turn, case in turns}
    todo = [each for each in turns if kept.get(keys[each]) is None]
    for number, (turn, case) in enumerate(todo):
        if progress:
            progress(number / len(todo), f"{case.kind} {case.name}")
        photo, entry = bench.timed(case, judge if turn == 0 else None)
        entry["db"] = psnr(photo.clean, whole if case.one_part else full)
        kept.put(keys[turn, case], entry)
    rows = []
    for each in cases:
        entries = [kept.get(keys[turn]) or {} for turn in turns if turn[1] is each]
        row = _row(each, entries)
        moved = shifts(entries[0].get("scores", {}), of_part if each.one_part else of_full)
        rows.append(replace(row, shifts=moved))
    return rows


@dataclass(frozen=True)
class _Bench:
    """What all cases share; see `measure`."""

    view: View
    camera: Camera
    kept: Kept
    device: str
    clock: Callable[[], float]
    pace: Callable[[], float] | None
    judge: Judge | None

    def timed(self, case: Case, judge: Judge | None) -> tuple[Photo, Json]:
        psf_memory.forget()
        before = self.pace() if self.pace else 0.0
        started = self.clock()
        photo = capture(self.view, self.camera, case.fidelity, device=self.device, clock=self.clock)
        seconds = self.clock() - started
        entry: Json = {"case": f"{case.kind} {case.name}", "seconds": seconds, "stages": dict(photo.seconds)}
        if self.pace:
            entry["pace"] = (before + self.pace()) / 2
        if judge:
            taken = (case.fidelity, photo, self.device, case.alone)
            entry["scores"] = dict(judge.scores(self.view, self.camera, *taken))
        return photo, entry

    def reference(self, case: Case, folder: Path) -> Tensor:
        """The full simulation's photo, kept in the folder with its measurement: it takes longest of all."""
        key = self.key(case, 0)
        path = folder / f"{case.name.replace(', ', '-').replace(' ', '-')}-{key[:16]}.safetensors"
        before = found(path, lambda path: load_file(path)["photo"])
        if before is not None:
            return before
        photo, entry = self.timed(case, self.judge)
        keep(path, lambda path: save_file({"photo": photo.clean.contiguous()}, path))
        self.kept.put(key, {**entry, "db": math.inf})
        return photo.clean

    @cached_property
    def about(self) -> dict[str, object]:
        """What decides all measurements of a photo, for keys."""
        digest = hashlib.sha256(self.camera.key().encode())
        for tensor in (self.view.radiance.sum(0), self.view.inverse_depth):
            digest.update(tensor.detach().cpu().contiguous().numpy().tobytes())
        judge = self.judge
        return {
            "machine": machine(),
            "device": self.device,
            "clock": self.clock.__name__,
            "threads": torch.get_num_threads(),
            "photo": digest.hexdigest(),
            "judge": None if judge is None else [*judge.restorers, judge.seeds, judge.alone is not None],
        }

    def key(self, case: Case, turn: int) -> str:
        named = [case.kind, case.name, repr(case.fidelity), repr(case.alone)]
        return key_of(**self.about, case=named, turn=turn)


def _row(case: Case, entries: list[Json]) -> Measured:
    stages = {
        stage: statistics.median(entry["stages"].get(stage, 0.0) for entry in entries) for stage in STAGES
    }
    seconds = statistics.median(entry["seconds"] for entry in entries)
    pace = statistics.median(entry.get("pace", 0.0) for entry in entries)
    return Measured(case, float(entries[0]["db"]), seconds, stages, len(entries), pace)


def pareto(rows: list[Measured]) -> list[Measured]:
    """The rows that no other beats in both time and error, fastest first."""
    front: list[Measured] = []
    for row in sorted(rows, key=lambda row: (row.seconds, -row.measured_db)):
        if not front or row.measured_db > front[-1].measured_db:
            front.append(row)
    return front


def figures(rows: list[Measured]) -> dict[str, float]:
    """Flat: measured and predicted PSNR and seconds of each case."""
    found: dict[str, float] = {}
    for row in rows:
        name = f"{row.case.kind}.{row.case.name}".replace(" ", "_")
        found[f"psnr_db.{name}"] = row.measured_db
        found[f"seconds.{name}"] = row.seconds
        found[f"predicted_db.{name}"] = row.case.predicted_db
        found[f"predicted_seconds.{name}"] = row.case.predicted_seconds
        found |= {f"seconds.{name}.{stage}": value for stage, value in row.stages.items()}
        for what, shift in row.shifts.items():
            said = what.replace(" ", "_")
            found[f"shift_db.{name}.{said}"] = shift.mean
            found[f"noise_db.{name}.{said}"] = shift.noise
    return found


def write_table(path: Path, rows: list[Measured]) -> Path:
    """All rows as CSV."""
    header = ("kind", "case", "asked_db", "measured_db", "predicted_db", "seconds", "predicted_seconds")
    return write_csv(
        path,
        (*header, *(f"{stage}_seconds" for stage in STAGES), "repeats"),
        (
            (
                row.case.kind,
                row.case.name,
                row.case.asked_db,
                row.measured_db,
                row.case.predicted_db,
                row.seconds,
                row.case.predicted_seconds,
                *(row.stages.get(stage, 0.0) for stage in STAGES),
                row.repeats,
            )
            for row in rows
        ),
    )
