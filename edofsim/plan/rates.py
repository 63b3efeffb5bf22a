"""How fast this machine does each kind of work: measured once in a few seconds, and remembered."""

from __future__ import annotations

import hashlib
import json
import os
from pathlib import Path

import numpy as np
import platformdirs
import torch
from scipy.optimize import nnls

from ..optics import Camera
from ..optics import cache as psf_memory
from ..recipe import CameraRecipe
from ..record import machine
from ..render.view import View
from .photographing import nodes_of, photograph
from .simulation import Simulation
from .work import STAGES, shape_of, work_of

VERSION = 4
"""Raised when work is counted otherwise."""

Rates = dict[str, tuple[float, ...]]
"""Seconds a unit of each amount of work, by stage (see `Work`)."""

_known: dict[str, Rates] = {}

RUNS = (
    Simulation(groups=1, colours=1, layers=2, occlusion="none"),
    Simulation(groups=1, colours=2, layers=12, occlusion="none"),
    Simulation(groups=2, colours=2, layers=5, occlusion="none", window=64),
    Simulation(groups=0, layers=3, occlusion="none"),
    Simulation(groups=0, layers=12, occlusion="none", window=32),
    Simulation(groups=3, colours=1, layers=6, occlusion="none", pupil_um=9.0),
    Simulation(groups=1, colours=0, layers=4, occlusion="none", oversampling=4),
    Simulation(groups=1, colours=1, layers=6, occlusion="hidden"),
    Simulation(groups=2, colours=1, layers=10, occlusion="hidden", window=64),
    Simulation(groups=1, colours=2, layers=4, occlusion="normalised"),
)


def rates(again: bool = False) -> Rates:
    """This machine's rates, from memory, from the user's cache, or measured now."""
    name = _name()
    if name in _known and not again:
        return _known[name]
    path = _folder() / f"rates-{name}.json"
    if not again and path.is_file():
        try:
            _known[name] = {k: tuple(v) for k, v in json.loads(path.read_text(encoding="utf-8")).items()}
            return _known[name]
        except (OSError, ValueError, TypeError, AttributeError):
            pass  # a damaged file is measured again
    _known[name] = measure()
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary = path.with_suffix(f".{os.getpid()}.tmp")
        temporary.write_text(json.dumps(_known[name], indent=1), encoding="utf-8")
        temporary.replace(path)
    except OSError:
        pass  # measured again by the next process
    return _known[name]


def _folder() -> Path:
    return Path(platformdirs.user_cache_dir("edofsim", appauthor=False))


def _name() -> str:
    about = [machine()["processor"], machine()["cores"], torch.get_num_threads(), torch.__version__, VERSION]
    return hashlib.sha256(json.dumps(about).encode()).hexdigest()[:16]


def measure(repeats: int = 2) -> Rates:
    """Photograph made-up views in several ways, and solve for the seconds of each kind of work.

    The fastest of some repeats counts: what else the machine did is not the work's. Errors are relative, so
    that short stages are met as well as long ones.
    """
    camera = Camera.from_recipe(CameraRecipe(name="rates"))
    rows: dict[str, list[tuple[float, ...]]] = {stage: [] for stage in STAGES}
    times: dict[str, list[float]] = {stage: [] for stage in STAGES}
    for size, runs, times_each in ((96, RUNS, repeats), (256, RUNS[::4], 1)):
        view = _made_up(size, camera)
        shape = shape_of(view, camera)
        for run in runs:
            found = []
            for _ in range(times_each):
                psf_memory.forget()
                photo = photograph(view, camera, run)
                found.append(photo.seconds)
            layers = int(nodes_of(view, camera, run).numel())
            groups = photo.how["bands"]
            colours = groups * max(run.colours, 1) if run.groups and run.colours else view.bands
            work = work_of(shape, camera, run, layers, groups, colours)
            for stage in STAGES:
                rows[stage].append(work.amounts[stage])
                times[stage].append(min(each[stage] for each in found))
    psf_memory.forget()
    return {stage: _solved(np.array(rows[stage]), np.array(times[stage])) for stage in STAGES}


def _solved(rows: np.ndarray, seconds: np.ndarray) -> tuple[float, ...]:
    scale = np.abs(rows).max(0)
    seconds = np.maximum(seconds, 1e-6)
    found, _ = nnls(rows / scale / seconds[:, None], np.ones(len(rows)))
    return tuple((found / scale).tolist())


def _made_up(size: int, camera: Camera) -> View:
    """Noise at many depths, a square of it in front of the rest and hiding it."""
    margin, bands = 64, 31
    side = size + 2 * margin
    draw = torch.Generator().manual_seed(0)
    row, column = torch.meshgrid(torch.arange(side), torch.arange(side), indexing="ij")
    front = ((row - side // 2).abs() < size // 4) & ((column - side // 2).abs() < size // 4)
    depth = torch.rand(side * side, generator=draw)
    behind = torch.nonzero(front.flatten()).squeeze(1)
    depth[behind] = 1.5 + 0.5 * depth[behind]
    pixel = torch.cat([torch.arange(side * side), behind])
    inverse_depth = torch.cat([depth, torch.rand(len(behind), generator=draw)])
    hidden = torch.arange(len(pixel)) >= side * side
    order = torch.argsort(pixel * 2 + hidden)
    return View(
        height=size,
        width=size,
        margin=margin,
        pixel=pixel[order],
        coverage=torch.ones(len(pixel)),
        inverse_depth=inverse_depth[order],
        radiance=torch.rand(bands, len(pixel), generator=draw)[:, order],
        hidden=hidden[order],
        wavelengths=torch.linspace(420e-9, 720e-9, bands, dtype=torch.float64),
        pixel_angle=camera.pixel_angle,
    )
