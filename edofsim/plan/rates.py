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
from torch import Tensor

from ..core.sources import code_of_rooms
from ..core.store import found, keep, user_folder
from ..optics.threads import all_threads, threads_allowed
from ..record import machine
from .work import STAGES

Rates = Mapping[str, tuple[float, ...]]
"""Seconds a unit of each amount of work, by stage (see `Work`); and the paces that they were measured at."""
PACE = "pace"
KINDS: Mapping[str, tuple[str, ...]] = {
    "prepare": ("calls", "elements", "moves", "moves", "elements", "calls"),
    "psf": (*("calls",) * 2, *("elements",) * 4, "products", *("elements",) * 2),
    "blur": (*("calls",) * 3, "transforms", "elements", *("moves",) * 2, "elements"),
    "sub_apertures": ("calls", "products", "elements", "transforms", "elements"),
    "sensor": ("calls", "elements", "moves", "elements", "moves"),
}
"""Of work that each rate is of: calls of little operations, products of matrices, Fourier transforms,
elements that are reckoned with, fragments that are moved. Machines differ in each of them by itself."""
IN_MOMENTS = ("psf", "sub_apertures")
"""Stages whose threads work on pieces of their own, and wait for each other now and then; those of the others
share each operation."""
SHARED = 0.4
"""What threads gain that wait: n of them are n to this power times as fast as one."""

SHIPPED: Rates = {
    "prepare": (0.001458, 0.0, 2.635e-11, 7.992e-09, 2.288e-08, 3.777e-06),
    "psf": (0.0, 0.0006309, 2.161e-08, 1.798e-08, 2.986e-10, 2.28e-08, 9.485e-11, 7.65e-09, 0.0),
    "blur": (0.002235, 0.0, 0.000103, 8.279e-11, 2.831e-09, 1.235e-09, 6.035e-08, 0.0),
    "sub_apertures": (0.002373, 2.322e-10, 1.257e-09, 0.0, 5.867e-09),
    "sensor": (0.0001124, 1.671e-08, 4.784e-12, 2.669e-11, 9.648e-10),
    PACE: (0.0003107, 0.001231, 0.0006072, 0.0005626, 0.0003522),
}
"""Of one thread of an Intel Xeon with AMX, as `benchmarks/photo_rates.py` measures them."""
KEPT = 9
"""Photos that the correction of a stage is the median of; the latest count."""
SHORTEST_S = 0.02
"""Stages that are predicted to take less say nothing of the machine."""
NEAR = 5.0
"""A photo that took so many times more or less than predicted met something else: PSFs that were known, other
work."""

_known: dict[str, Rates] = {}


def rates() -> Rates:
    """This machine's rates for this process, with the corrections that are kept."""
    name = _name()
    if name not in _known:
        _known[name] = _corrected(paces())
    return _known[name]


def _corrected(now: tuple[float, ...]) -> Rates:
    """now: the paces of this machine, for all threads."""
    of_pieces = [each * threads_allowed() ** (1 - SHARED) for each in now]
    corrections = {stage: _median(ratios) for stage, ratios in _corrections().items()}
    found: dict[str, tuple[float, ...]] = {PACE: now}
    for stage in STAGES:
        own = of_pieces if stage in IN_MOMENTS else now
        slower = {kind: each / usual for kind, each, usual in zip(_MOMENTS, own, SHIPPED[PACE], strict=True)}
        by = corrections.get(stage, 1.0)
        found[stage] = tuple(
            by * slower[kind] * each for kind, each in zip(KINDS[stage], SHIPPED[stage], strict=True)
        )
    return found


def learn(predicted: Mapping[str, float], taken: Mapping[str, float]) -> None:
    """Correct the rates by the seconds that stages of a photo were predicted to take, by `rates`, and
    took."""
    name, corrections = _name(), _corrections()
    changed = False
    for stage in STAGES:
        if min(predicted.get(stage, 0.0), taken.get(stage, 0.0)) < SHORTEST_S:
            continue
        before = _median(corrections.get(stage, []))
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


def _median(ratios: list[float]) -> float:
    return statistics.median(ratios) if ratios else 1.0


def _file() -> Path:
    return user_folder() / f"rates-{_name()}.json"


def _name() -> str:
    about = [machine()["processor"], machine()["cores"], threads_allowed(), torch.__version__]
    about += code_of_rooms("plan")
    return hashlib.sha256(json.dumps(about).encode()).hexdigest()[:16]


def pace() -> float:
    """Seconds for a piece of work of each kind: times that were taken at different paces are compared as
    multiples of it."""
    return sum(paces())


def paces(repeats: int = 4) -> tuple[float, ...]:
    """Seconds for a fixed piece of work of each kind, see `KINDS`, each about a millisecond, on as many
    threads as photos have: of the processor where that is one. The fastest of the repeats.

    Even these grow when other work keeps the cores' shared parts busy.
    """
    clock = time.thread_time if threads_allowed() == 1 else time.perf_counter  # of all counts busy waiting
    with all_threads():
        return tuple(_fastest(work, repeats, clock) for work in _MOMENTS.values())


def _fastest(work: Callable[[], object], repeats: int, clock: Callable[[], float]) -> float:
    taken = []
    for _ in range(repeats):
        started = clock()
        work()
        taken.append(clock() - started)
    return min(taken)


@lru_cache(maxsize=1)
def _like_a_photo() -> dict[str, Tensor]:
    draw = torch.Generator().manual_seed(0)
    shapes = {
        "images": (8, 128, 128),
        "angles": (100_000,),
        "fragments": (3, 40_000),
        "spread": (120, 4 * 1200),
        "basis": (100, 120),
        "little": (3, 8),
    }
    made = {name: torch.rand(shape, generator=draw) for name, shape in shapes.items()}
    made["spectra"] = torch.fft.rfft2(made["images"])
    return {**made, "place": torch.randperm(40_000, generator=draw)}


def _calls() -> None:
    little = _like_a_photo()["little"]
    for _ in range(100):
        little = little.flip(0).contiguous().mul_(1.0)


def _products() -> None:
    made = _like_a_photo()
    for _ in range(2):
        torch.mm(made["basis"], made["spread"])


def _transforms() -> None:
    images, spectra = (_like_a_photo()[name] for name in ("images", "spectra"))
    for _ in range(2):
        torch.fft.rfft2(images, out=spectra)
        torch.fft.irfft2(spectra, out=images)


def _elements() -> None:
    angles = _like_a_photo()["angles"]
    field = torch.polar(angles, angles)
    field.mul_(field.conj()).add_(field)


def _moves() -> None:
    made = _like_a_photo()
    light = made["fragments"][:, made["place"]]
    torch.zeros_like(light).index_add_(1, made["place"], light)


_MOMENTS: Mapping[str, Callable[[], None]] = {
    "calls": _calls,
    "products": _products,
    "transforms": _transforms,
    "elements": _elements,
    "moves": _moves,
}
