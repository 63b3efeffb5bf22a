"""The cameras of a training over many, each with the PSFs of its depth range and what a network is told."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from ..capture.blurring import Blurring
from ..capture.kernels import HeldKernels, depth_nodes
from ..capture.occlusion import OCCLUSIONS
from ..capture.photograph import glare_of
from ..capture.prepare import blur_per_dioptre
from ..core.progress import Progress
from ..errors import InputError
from ..optics import PAPER_COLOURS, psf_bank
from ..optics.nodes import node_shares, nodes_between
from ..optics.sampling import plan_sampling
from ..recipe.train import CamerasTable, TrainRecipe
from ..render.view import View
from ..restore.camera_bank import CameraBank, Conditioning
from ..restore.depths import closer_about_focus
from ..restore.light import without_glare
from ..restore.restore import deconvolved
from ..restore.restorer import Restorer
from .random_cameras import RandomCamera, random_camera
from .schedule import generator_of
from .system import Captured, Optics

DRAWN = 8  # purpose of random numbers
LARGEST_PUPIL = 1400  # samples across: larger ones take too long
TRUNCATED = 0.6  # cameras that throw more of the light out of the window are not trained with
VALIDATION = 100_000  # number of the first camera for validation


@dataclass(frozen=True)
class PooledOptics(Optics):
    """PSFs that are looked up. stored: float16 [n, 3, window, window], at the middles of n equal parts of a
    camera's range, which stands for the inverse depths `drawn` (least, largest) of the scenes; widest: blur
    without mask by which the ends of the range differ, in pixels."""

    stored: Tensor
    drawn: tuple[float, float]
    widest: float

    def with_height(self, height: Tensor | None) -> PooledOptics:
        return self

    def psfs(self, inverse_depths: Tensor) -> Tensor:
        low, high = self.drawn
        part = (inverse_depths - low) / (high - low) * len(self.stored)
        return self.stored[part.long().clamp(0, len(self.stored) - 1)].to(torch.float32)

    def view(self, view: View, layers: int, occlusion: str) -> tuple[Tensor, Tensor]:
        """A view of the three colours whose depths are among `drawn`: unexposed photo without noise, [3, y,
        x], and the fraction of light that left the PSFs' window, [3]."""
        nodes = depth_nodes(view.inverse_depth, layers, 0.0)
        kernels = HeldKernels(self.psfs(nodes), nodes, view.wavelengths)
        each = torch.eye(3, device=self.device)
        gap = (self.drawn[1] - self.drawn[0]) / self.widest
        image = OCCLUSIONS[occlusion](view, Blurring(kernels, each, gap))
        glare, truncated = glare_of(view, kernels, each)
        return view.crop_margin(image) + glare[:, None, None], truncated


@dataclass(frozen=True)
class Pooled:
    """A camera; known: what the network is told of it; shares: [n], how much each of the n stored PSFs counts
    for Wiener deconvolution."""

    name: str
    optics: PooledOptics
    read_noise: float
    known: Conditioning
    shares: Tensor

    def tell(self, network: Restorer) -> None:
        assert isinstance(network, CameraBank)
        network.use(self.known)

    def seen(self, network: Restorer, photo: Tensor, captured: Captured) -> Tensor:
        """The photo without its glare, and where the network sees it what Wiener deconvolution makes of that,
        as in use."""
        psf = captured.psf
        glare = captured.truncated.expand(3) if psf is None else 1 - psf.sum((-1, -2))
        photo = without_glare(photo, glare)
        if not network.sees_linear:
            return photo
        some = self.shares > 0
        psfs = self.optics.stored[some.to(self.optics.stored.device)].to(photo)
        linear = deconvolved(photo, psfs, self.read_noise, self.shares[some])
        return torch.cat([photo, linear], 1)


@dataclass(frozen=True)
class CameraPool:
    """Those to train with, and others to validate with."""

    training: tuple[Pooled, ...]
    validation: tuple[Pooled, ...]

    def camera(self, seed: int, step: int) -> Pooled:
        """That of a step, the same for all workers."""
        generator = generator_of(seed, DRAWN, step, 0)
        return self.training[int(torch.randint(len(self.training), (), generator=generator))]


def camera_pool(
    recipe: TrainRecipe, network: Restorer, device: torch.device, progress: Progress | None
) -> CameraPool | None:
    """The cameras of a recipe's table, the same each time; None where it has none. Raises InputError for a
    network that cannot be trained over cameras, and for ranges that hold none."""
    table = recipe.cameras
    if (table is None) == isinstance(network, CameraBank):
        raise InputError(
            "network.kind = 'camera-bank' and a table [cameras] go together: that network is for any camera"
        )
    if table is None or not isinstance(network, CameraBank):
        return None
    pools: list[list[Pooled]] = []
    for first, count in ((0, table.count), (VALIDATION, table.validation)):
        pool: list[Pooled] = []
        for number in range(first, first + count):
            if progress:
                progress(0.0, f"camera {number - first + 1} of {count}")
            pool.append(_pooled(table, recipe, number, network, device))
        pools.append(pool)
    return CameraPool(tuple(pools[0]), tuple(pools[1]))


def _pooled(
    table: CamerasTable, recipe: TrainRecipe, number: int, network: CameraBank, device: torch.device
) -> Pooled:
    for attempt in range(100):
        drawn = random_camera(table, recipe.seed, number, attempt, recipe.capture.read_noise)
        depths = network.psf_depths(drawn.depths)
        psf = _psfs(drawn, table.window_px, depths)
        if psf is None or float(1 - psf.sum((-1, -2)).mean()) > TRUNCATED:
            continue
        # what it is told is of other depths than photos are taken by, as in use
        closer = closer_about_focus(drawn.camera, depths)
        told = psf if torch.equal(closer, depths) else _psfs(drawn, table.window_px, closer)
        if told is not None:
            break
    else:
        raise InputError("cameras: hardly one within these ranges keeps its light in window_px; widen it")
    known = network.condition(told, drawn.read_noise)
    optics = PooledOptics(
        drawn.camera,
        table.window_px,
        device,
        psf.to(torch.float16).to(device),
        recipe.capture.inverse_depth_per_m,
        blur_per_dioptre(drawn.camera) * (drawn.depths[1] - drawn.depths[0]),
    )
    return Pooled(drawn.camera.recipe.name, optics, drawn.read_noise, known, _shares(drawn, len(depths)))


def _shares(drawn: RandomCamera, parts: int) -> Tensor:
    """How much each of so many equal parts of a camera's range counts for Wiener deconvolution: its nodes'
    shares, [part]."""
    low, high = drawn.depths
    nodes = nodes_between(drawn.camera, PAPER_COLOURS, low, high)
    place = ((nodes - low) / (high - low) * parts).long().clamp(0, parts - 1)
    return torch.zeros(parts, dtype=torch.float64).index_add(0, place, node_shares(nodes))


def _psfs(drawn: RandomCamera, window: int, inverse: Tensor) -> Tensor | None:
    """[depth, 3, window, window] at inverse depths in 1/m; None for a camera whose pupil would have to be
    sampled too finely."""
    try:
        if plan_sampling(drawn.camera, PAPER_COLOURS, inverse, window).grid.samples > LARGEST_PUPIL:
            return None
        if drawn.broadband:
            return Optics(drawn.camera, window, torch.device("cpu")).response_psfs(inverse)
        return psf_bank(drawn.camera, PAPER_COLOURS, inverse, window_px=window).values
    except InputError:
        return None
