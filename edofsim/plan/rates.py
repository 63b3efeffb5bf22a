"""How fast this machine does each kind of work: rates that ship, scaled by a moment's work, and corrected by
what photos on this machine then took."""

from __future__ import annotations

import hashlib
import json
import math
import statistics
import time
from collections.abc import Callable, Mapping
from functools import lru_cache
from pathlib import Path

import torch

from ..core.sources import code_of_rooms
from ..core.store import found, keep, user_folder
from ..core.threads import all_threads, threads_allowed
from ..record import machine
from .work import STAGES

Rates = Mapping[str, Mapping[str, float]]
"""Seconds a unit of each kind of work, by stage (see `Work`); and under `PACE`, those of a moment's work
of each kind where they were measured."""
PACE = "pace"
PARALLEL_STAGES = ("psf", "sub_apertures")
"""Stages whose threads work on pieces of their own, and wait for each other now and then; those of the others
share each operation."""
SHARED = 0.4
"""What threads gain that wait: n of them are n to this power times as fast as one."""

SHIPPED: Rates = {
    "prepare": {"calls": 0.0015, "moves": 8e-09, "elements": 2.3e-08},
    "psf": {"calls": 0.00063, "elements": 1.9e-08, "products": 9.5e-11},
    "blur": {"calls": 0.0001, "transforms": 8.3e-11, "elements": 2.8e-09, "moves": 6e-08},
    "sub_apertures": {"calls": 0.0024, "products": 2.3e-10, "elements": 5.9e-09},
    "sensor": {"elements": 1.7e-08},
    PACE: {
        "calls": 0.0003107,
        "products": 0.001231,
        "transforms": 0.0006072,
        "elements": 0.0005626,
        "moves": 0.0003522,
    },
}
"""Of one thread of an Intel Xeon with AMX, as `docs/studies/photo_rates.py` measured them: what is chosen
follows from these on every machine."""
TODAY: Rates = {
    "prepare": {"calls": 0.002, "moves": 2.1e-08, "elements": 3e-08},
    "psf": {"calls": 0.0008, "elements": 2.3e-08, "products": 2.6e-10},
    "blur": {"calls": 8.4e-05, "transforms": 1.1e-10, "moves": 3.4e-08},
    "sub_apertures": {"calls": 0.0072, "products": 4.7e-10, "elements": 1.9e-09},
    "sensor": {"elements": 8.3e-08},
    PACE: {
        "calls": 0.0004684,
        "products": 0.002686,
        "transforms": 0.0009344,
        "elements": 0.0007108,
        "moves": 0.0003695,
    },
}
"""Seconds that are reported follow from these: of one thread of an AMD EPYC, as the same study finds them by
photos of scenes for validation."""
KEPT = 9
"""Photos that the correction of a stage is the median of; the latest count."""
SHORTEST_S = 0.02
"""Stages that are predicted to take less say nothing of the machine."""
NEAR = 5.0
"""A photo that took this many times more or less than predicted met something else: PSFs that were known,
other work."""

_known: dict[str, Rates] = {}


def rates() -> Rates:
    """This machine's rates for this process, with the corrections that are kept."""
    name = _name()
    if name not in _known:
        _known[name] = _corrected(paces())
    return _known[name]


def _corrected(now: Mapping[str, float]) -> Rates:
    """now: the paces of this machine, for all threads."""
    corrections, found = _corrections(), {PACE: now}
    for stage in STAGES:
        by = _correction(stage, corrections) * (
            threads_allowed() ** (1 - SHARED) if stage in PARALLEL_STAGES else 1.0
        )
        found[stage] = {
            kind: by * rate * now[kind] / TODAY[PACE][kind] for kind, rate in TODAY[stage].items()
        }
    return found


def learn(predicted: Mapping[str, float], taken: Mapping[str, float]) -> None:
    """Correct the rates by the seconds that stages of a photo were predicted to take, by `rates`, and
    took."""
    name, corrections = _name(), _corrections()
    changed = False
    for stage in STAGES:
        if min(predicted.get(stage, 0.0), taken.get(stage, 0.0)) < SHORTEST_S:
            continue
        before = _correction(stage, corrections)
        if 1 / NEAR < taken[stage] / predicted[stage] < NEAR:
            ratios = [*corrections.get(stage, []), before * taken[stage] / predicted[stage]]
            corrections[stage] = ratios[-KEPT:]
            changed = True
    if changed:
        content = json.dumps(corrections, indent=1)
        keep(_file(), lambda path: path.write_text(content, encoding="utf-8"))
        if name in _known:
            _known[name] = _corrected(_known[name][PACE])


def _corrections() -> dict[str, list[float]]:
    return found(_file(), _read) or {}


def _read(path: Path) -> dict[str, list[float]]:
    content = json.loads(path.read_text(encoding="utf-8"))
    kept = {stage: [float(each) for each in content[stage]] for stage in STAGES if stage in content}
    if not all(math.isfinite(each) and each > 0 for ratios in kept.values() for each in ratios):
        raise ValueError("no positive numbers")
    return kept


def _correction(stage: str, ratios: Mapping[str, list[float]]) -> float:
    return statistics.median(ratios[stage]) if ratios.get(stage) else 1.0


def _file() -> Path:
    return user_folder() / f"rates-{_name()}.json"


def _name() -> str:
    about = [machine()["processor"], machine()["cores"], threads_allowed(), torch.__version__]
    about += code_of_rooms("plan")
    return hashlib.sha256(json.dumps(about).encode()).hexdigest()[:16]


def pace() -> float:
    """Seconds for a piece of work of each kind: times that were taken at different paces are compared as
    multiples of it."""
    return sum(paces().values())


def paces(repeats: int = 4) -> Mapping[str, float]:
    """Seconds for a fixed piece of work of each of `KINDS`, each about a millisecond, on as many
    threads as photos have: of the processor where that is one. The fastest of the repeats.

    Even these grow when other work keeps the cores' shared parts busy.
    """
    clock = time.thread_time if threads_allowed() == 1 else time.perf_counter  # of all counts busy waiting
    with all_threads():
        return {kind: _fastest(work, repeats, clock) for kind, work in _moments().items()}


def _fastest(work: Callable[[], object], repeats: int, clock: Callable[[], float]) -> float:
    taken = []
    for _ in range(repeats):
        started = clock()
        work()
        taken.append(clock() - started)
    return min(taken)


@lru_cache(maxsize=1)
def _moments() -> Mapping[str, Callable[[], None]]:
    """A piece of work of each of `KINDS`, as in a photo."""
    draw = torch.Generator().manual_seed(0)
    shapes = ((8, 128, 128), (100_000,), (3, 40_000), (120, 4 * 1200), (100, 120), (3, 8))
    images, angles, light, spread, basis, little = (torch.rand(shape, generator=draw) for shape in shapes)
    spectra, place = torch.fft.rfft2(images), torch.randperm(40_000, generator=draw)

    def calls() -> None:
        moved = little
        for _ in range(100):
            moved = moved.flip(0).contiguous().mul_(1.0)

    def products() -> None:
        for _ in range(2):
            torch.mm(basis, spread)

    def transforms() -> None:
        for _ in range(2):
            torch.fft.rfft2(images, out=spectra)
            torch.fft.irfft2(spectra, out=images)

    def elements() -> None:
        field = torch.polar(angles, angles)
        field.mul_(field.conj()).add_(field)

    def moves() -> None:
        moved = light[:, place]
        torch.zeros_like(moved).index_add_(1, place, moved)

    return {each.__name__: each for each in (calls, products, transforms, elements, moves)}
