"""How fast this machine does each kind of work: rates that ship, scaled by a moment's work, and corrected by
what photos on this machine then took."""

from __future__ import annotations

import hashlib
import json
import math
import statistics
import time
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path

import torch
from torch import Tensor

from ..core.store import found, keep, user_folder
from ..optics.threads import one_thread, threads_allowed
from ..record import machine
from .work import STAGES

VERSION = 18
"""Raised when work is counted otherwise."""

Rates = Mapping[str, tuple[float, ...]]
"""Seconds a unit of each amount of work, by stage (see `Work`); and the pace that they were measured at."""
PACE = "pace"

SHIPPED: Rates = {
    "prepare": (0.001272, 0.0, 0.0, 3.659e-09, 2.316e-08, 5.903e-06),
    "psf": (0.001492, 0.0006737, 0.0, 1.306e-08, 0.0, 3.084e-08, 1.877e-10, 3.848e-09, 0.0),
    "blur": (0.002653, 0.0, 0.0001881, 1.614e-10, 3.233e-10, 1.971e-10, 5.599e-08, 3.821e-09),
    "sub_apertures": (0.001377, 2.561e-10, 3.807e-09, 0.0, 5.308e-09),
    "sensor": (0.0001868, 1.604e-08, 0.0, 0.0, 6.22e-11),
    PACE: (0.005619,),
}
"""Of one thread of an AMD EPYC, as `benchmarks/photo_rates.py` measures them."""
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
        faster = pace() / SHIPPED[PACE][0]
        corrections = {stage: _median(ratios) for stage, ratios in _corrections().items()}
        scaled = {
            stage: tuple(faster * corrections.get(stage, 1.0) * each for each in SHIPPED[stage])
            for stage in STAGES
        }
        _known[name] = {**scaled, PACE: (faster * SHIPPED[PACE][0],)}
    return _known[name]


def learn(predicted: Mapping[str, float], taken: Mapping[str, float]) -> None:
    """Correct the rates by the seconds that stages of a photo were predicted to take, by `rates`, and
    took."""
    corrections = _corrections()
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
        _known.pop(_name(), None)


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
    about = [machine()["processor"], machine()["cores"], threads_allowed(), torch.__version__, VERSION]
    return hashlib.sha256(json.dumps(about).encode()).hexdigest()[:16]


@lru_cache(maxsize=1)
def _like_a_photo() -> tuple[Tensor, ...]:
    draw = torch.Generator().manual_seed(0)
    shapes = ((3, 320, 320), (3, 64, 64), (31, 60_000), (3, 31), (300, 300))
    return *(torch.rand(shape, generator=draw) for shape in shapes), torch.randperm(60_000, generator=draw)


def pace(repeats: int = 4) -> float:
    """Seconds of the processor for a fixed piece of work like a photo's, about 10 ms, on one thread.

    Even these grow when other work keeps the cores' shared parts busy: times that were taken at different
    paces are compared as multiples of it.
    """
    image, psf, light, weights, square, place = _like_a_photo()
    with one_thread():
        started = time.thread_time()  # of the process would count threads that wait busily for work
        for _ in range(repeats):
            spectrum = torch.fft.rfft2(image) * torch.fft.rfft2(psf, s=(320, 320))
            torch.fft.irfft2(spectrum)
            torch.zeros(3, 60_000).index_add_(1, place, weights @ light)
            for _ in range(4):
                torch.cos(square @ square)
        return (time.thread_time() - started) / repeats
