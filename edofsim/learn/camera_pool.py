"""The cameras of a training over many, each with the PSFs of its depth range and what a network is given."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from ..capture.prepare import blur_per_dioptre
from ..core.progress import Progress
from ..errors import InputError
from ..optics import PAPER_COLOURS
from ..optics.nodes import node_shares, nodes_between
from ..optics.sampling import plan_sampling
from ..recipe.train import CamerasTable, TrainRecipe
from ..restore import deconvolved
from ..restore.camera_bank import CameraBank, Conditioning
from ..restore.depths import closer_about_focus
from ..restore.light import without_glare
from ..restore.restorer import Restorer
from .random_cameras import RandomCamera, random_camera
from .schedule import generator_of
from .system import Captured
from .training_camera import StoredPsfs, TrainingCamera

DRAWN = 8  # purpose of random numbers
LARGEST_PUPIL = 1400  # samples across: larger ones take too long
TRUNCATED = 0.6  # cameras that throw more of the light out of the window are not trained with
VALIDATION = 100_000  # number of the first camera for validation


@dataclass(frozen=True)
class Pooled:
    """A camera.

    known: what the network is given of it.
    shares: [n], how much each of the n stored PSFs counts for Wiener deconvolution.
    """

    name: str
    optics: TrainingCamera
    read_noise: float
    known: Conditioning
    shares: Tensor

    def select_psfs(self, network: Restorer) -> None:
        assert isinstance(network, CameraBank)
        network.load_psf_state(self.known)

    def seen(self, network: Restorer, photo: Tensor, captured: Captured) -> Tensor:
        """The photo without its glare, and where the network sees it what Wiener deconvolution makes of that,
        as in use.

        photo: [batch, 3, y, x].
        """
        psf = captured.psf
        glare = captured.truncated.expand(3) if psf is None else 1 - psf.sum((-1, -2))
        photo = without_glare(photo, glare)
        if not network.sees_linear:
            return photo
        some = self.shares > 0
        stored = self.optics.stored
        assert stored is not None
        psfs = stored.values[some.to(stored.values.device)].to(photo)
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
        # what it is given is of other depths than photos are taken by, as in use
        closer = closer_about_focus(drawn.camera, depths)
        given = psf if torch.equal(closer, depths) else _psfs(drawn, table.window_px, closer)
        if given is not None:
            break
    else:
        raise InputError("cameras: hardly one within these ranges keeps its light in window_px; widen it")
    known = network.condition(given, drawn.read_noise)
    optics = TrainingCamera(
        drawn.camera,
        table.window_px,
        device,
        StoredPsfs(
            psf.to(torch.float16).to(device),
            recipe.capture.inverse_depth_per_m,
            blur_per_dioptre(drawn.camera) * (drawn.depths[1] - drawn.depths[0]),
        ),
    )
    return Pooled(drawn.camera.recipe.name, optics, drawn.read_noise, known, _shares(drawn, len(depths)))


def _shares(drawn: RandomCamera, parts: int) -> Tensor:
    """How much each of this many equal parts of a camera's range counts for Wiener deconvolution: its nodes'
    shares, [part]."""
    low, high = drawn.depths
    nodes = nodes_between(drawn.camera, PAPER_COLOURS, low, high)
    place = ((nodes - low) / (high - low) * parts).long().clamp(0, parts - 1)
    return torch.zeros(parts, dtype=torch.float64).index_add(0, place, node_shares(nodes))


def _psfs(drawn: RandomCamera, window: int, inverse: Tensor) -> Tensor | None:
    """[depth, 3, window, window] at inverse depths in 1/m; None for a camera whose pupil would have to be
    sampled too finely."""
    try:
        if plan_sampling(drawn.camera, PAPER_COLOURS, inverse, window).samples > LARGEST_PUPIL:
            return None
        psf = TrainingCamera(drawn.camera, window, torch.device("cpu")).psfs(inverse, drawn.broadband)
        return psf.sum(2) if drawn.broadband else psf
    except InputError:
        return None
