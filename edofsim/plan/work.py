"""How much work a simulation is, counted and not done: wave transforms, convolutions, fragments moved."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import torch
from torch import Tensor

from ..expose.convolution import Grid
from ..expose.occlusion.slabs import cuts
from ..expose.prepare import blur_per_dioptre
from ..optics import Camera
from ..optics.sampling import plan_sampling
from ..render.view import View
from .simulation import Simulation, simpler_camera

BINS = 4096
STAGES = ("prepare", "psf", "blur", "sensor")


@dataclass(frozen=True)
class Shape:
    """What counts of a view for the time of its photo.

    occupied: bool [slab, bin], the depths at which each slab of the occlusion holds fragments, over the
    range `ends` (inverse depths); fragments: [slab] of each; visible: fragments that are seen; wavelengths:
    of the bands, in metres.
    """

    height: int
    width: int
    margin: int
    bands: int
    occupied: Tensor
    fragments: Tensor
    visible: int
    ends: tuple[float, float]
    wavelengths: tuple[float, ...]

    def nodes_used(self, layers: int, slab: int | None = None) -> int:
        """Depth nodes that some fragment of a slab (None: of the view) has a share in."""
        if layers == 1 or self.ends[0] == self.ends[1]:
            return 1
        here = self.occupied.any(0) if slab is None else self.occupied[slab]
        cells = (torch.nonzero(here).squeeze(1) * (layers - 1) // BINS).clamp_max(layers - 2)
        return int(torch.unique(torch.cat([cells, cells + 1])).numel())


def shape_of(view: View, camera: Camera) -> Shape:
    """Count a view once, for the work of any simulation of it."""
    depth = view.inverse_depth.double()
    low, high = float(depth.min()), float(depth.max())
    place = ((depth - low) / max(high - low, 1e-12) * BINS).long().clamp(0, BINS - 1)
    at = torch.tensor(sorted(cuts(view, 1 / blur_per_dioptre(camera))), dtype=torch.float64)
    slab = torch.searchsorted(at, depth)
    occupied = torch.zeros(at.numel() + 1, BINS, dtype=torch.bool)
    occupied[slab, place] = True
    return Shape(
        view.height,
        view.width,
        view.margin,
        view.bands,
        occupied,
        torch.bincount(slab, minlength=at.numel() + 1),
        int((~view.hidden).sum()),
        (low, high),
        tuple(view.wavelengths.tolist()),
    )


@dataclass(frozen=True)
class Work:
    """Amounts that a stage's time is proportional to, by stage; bytes: of PSFs, light and transforms."""

    amounts: dict[str, tuple[float, ...]]
    bytes: float


def work_of(
    shape: Shape, camera: Camera, simulation: Simulation, layers: int, groups: int, colours: int
) -> Work:
    """The work of a photo.

    layers: depth nodes; groups: images that are blurred for each of them; colours: wavelengths of PSFs.
    """
    window = simulation.window or camera.recipe.psf.window_px
    margin = window // 2
    rows, columns = shape.height + 2 * margin, shape.width + 2 * margin
    grid = Grid(rows, columns, margin, window)
    size = math.prod(grid.transform)
    per_transform = size * math.log2(size)
    outer = (shape.height + 2 * shape.margin) * (shape.width + 2 * shape.margin)
    scale = rows * columns / outer
    kernels, moved = 0, 0.0
    if simulation.occlusion == "none":
        kernels = shape.nodes_used(layers) * groups
        moved = 2.0 * shape.visible * scale * groups
    elif simulation.occlusion == "hidden":
        for slab, count in enumerate(shape.fragments.tolist()):
            kernels += shape.nodes_used(layers, slab) * (groups + 3)
            moved += 2.0 * count * scale * (groups + 3)
    else:
        kernels = shape.nodes_used(layers) * (groups + 3)
        moved = 2.0 * shape.visible * scale * (groups + 3)
    samples = _pupil_samples(camera, simulation, window, shape.ends, shape.wavelengths)
    half, out = samples / 2, (window * simulation.oversampling + 2) / 2
    waves = layers * colours * (out * half**2 + out**2 * half)
    whole = float(shape.fragments.sum())
    fragments = whole * scale
    moving = whole * (shape.bands + (groups if simulation.groups else 0)) + fragments * groups
    block = min(groups, max(1, (1 << 22) // size))
    return Work(
        {
            "prepare": (1.0, moving),
            "psf": (1.0, samples**2, colours * samples**2, waves, layers * colours * window**2),
            "blur": (1.0, kernels * per_transform, moved),
            "sensor": (1.0, 3.0 * shape.height * shape.width + fragments * groups),
        },
        4.0 * layers * (colours + (groups if simulation.groups else 0)) * window**2
        + 4.0 * fragments * (shape.bands + groups)
        + 24.0 * block * size,
    )


def _pupil_samples(
    camera: Camera, simulation: Simulation, window: int, ends: tuple[float, float], bands: tuple[float, ...]
) -> int:
    simpler = simpler_camera(camera, simulation)
    recipe = simpler.recipe.model_dump_json(exclude={"name", "purpose", "sensor"})
    return _samples(_Named(simpler, recipe), window, ends, bands)


class _Named:
    """A camera that is told from others by its recipe."""

    def __init__(self, camera: Camera, name: str) -> None:
        self.camera, self.name = camera, name

    def __hash__(self) -> int:
        return hash(self.name)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Named) and self.name == other.name


@lru_cache(maxsize=512)
def _samples(named: _Named, window: int, ends: tuple[float, float], bands: tuple[float, ...]) -> int:
    wavelengths = torch.tensor(bands, dtype=torch.float64)
    depths = torch.tensor(ends, dtype=torch.float64)
    return plan_sampling(named.camera, wavelengths, depths, window).grid.samples
