"""From a training recipe to everything the loop needs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import torch
from torch import Tensor, nn

from ..core.json_values import Json
from ..core.progress import Progress
from ..errors import InputError
from ..optics import Camera
from ..optics.grid import PupilGrid
from ..optics.height import designed_map, natural_samples
from ..optics.masks import Mask, PhaseMask, asked
from ..optics.masks.height_map import HeightMapMask
from ..recipe.camera import CameraRecipe
from ..recipe.kinds import MASKS
from ..recipe.load import Loaded, load_camera
from ..recipe.train import TrainRecipe
from ..restore.bfloat16 import multiplied_fast
from ..restore.checkpoint import history_of, load_checkpoint
from ..restore.losses import LossWeights, restoration_loss
from ..restore.network import build_network, network_class
from ..restore.own_network import OwnNetwork
from ..restore.restorer import Restorer
from .camera_pool import CameraPool, camera_pool
from .doe import FixedHeight, FreeHeight, MaskMaps, NoHeight, maps_of, metres_per_radian
from .reader import Source
from .system import System
from .training_camera import TrainingCamera
from .training_data import TrainingData, gather, mixed
from .workers import Workers

MASK_PITCH_UM = 21.0  # the paper's sampling of a mask for its depth range
SAME_HEIGHT = 1e-10  # metres: learned heights are rounded when they are saved
ROUNDING = 1e-3  # relative, of heights that were held within a limit


@dataclass(frozen=True)
class Given:
    """What is given in Python, in place of what a recipe names.

    mask: gives a height map [n, n] in metres.
    loss: of a restored image and the ideal one.
    source: None for those of the recipe.
    """

    camera: Camera
    network: Restorer
    mask: nn.Module | None = None
    loss: Callable[[Tensor, Tensor], Tensor] | None = None
    source: Source | None = None


@dataclass(frozen=True)
class Setup:
    """recipe and camera as the card records them.

    sampling: pitch of the height map in metres, None without one.
    history: of the checkpoint that the network starts from.
    auxiliary: that of the auxiliary network.
    pool: cameras in place of one.
    """

    recipe: TrainRecipe
    camera: CameraRecipe
    system: System
    data: TrainingData
    sampling: float | None
    device: torch.device
    history: tuple[Json, ...] = ()
    auxiliary: tuple[Json, ...] = ()
    pool: CameraPool | None = None

    @property
    def judged_at_start(self) -> bool:
        """Whether the network may restore before the first step."""
        return self.recipe.network.start is not None or isinstance(self.system.network, OwnNetwork)

    def maps(self) -> MaskMaps:
        """The mask as designed, without errors of fabrication, on the CPU."""
        with torch.no_grad():
            maps = maps_of(self.system.mask)
        return MaskMaps(*(None if one is None else one.detach().cpu() for one in maps))


def prepare(
    loaded: Loaded[TrainRecipe],
    data: Path | None,
    workers: Workers,
    cache: Path | None = None,
    progress: Progress | None = None,
    given: Given | None = None,
) -> Setup:
    """Read the data, build the mask and the network. Raises InputError for what the recipe cannot have."""
    recipe = loaded.recipe
    camera, base = _camera(recipe, loaded.base) if given is None else (given.camera.recipe, given.camera.base)
    if given is not None and given.mask is not None:
        mask, sampling, with_mask = camera_of(given.mask, given.camera)
        camera = with_mask
    else:
        mask, sampling, with_mask = build_mask(recipe, camera, base)
    optics = TrainingCamera(Camera.from_recipe(with_mask, base), with_mask.psf.window_px, workers.device)
    with torch.no_grad():
        designed = optics.with_mask(maps_of(mask.to(workers.device)))
    if given is not None and given.source is not None:
        training_data = mixed(recipe, [given.source])
    else:
        training_data = gather(recipe, designed, loaded.base, data, cache, progress)
    network, history = _network(recipe, camera) if given is None else (given.network, ())
    if optics.camera.lens.varies:
        _check_varying(recipe, camera, network)
    with torch.no_grad():
        network, auxiliary = _with_auxiliary(recipe, camera, network, maps_of(mask).height)
    loss = None if given is None else given.loss
    loss = loss.to(workers.device) if isinstance(loss, nn.Module) else loss
    numbers = recipe.optimiser.precision
    weights = LossWeights(recipe.loss.alpha, recipe.loss.beta, recipe.loss.gamma)
    system = System(
        optics,
        mask,
        network,
        partial(restoration_loss, weights=weights) if loss is None else loss,
        recipe.loss.truncated_energy,
        recipe.doe.height_noise_nm * 1e-9,
        recipe.capture.inverse_depth_per_m,
        bfloat16=multiplied_fast(workers.device) if numbers == "auto" else numbers == "bfloat16",
        light_kept=recipe.loss.light_kept,
    )
    system.to(workers.device)
    # pyrefly: ignore[no-matching-overload] - torch's stubs leave this one out
    system.network.to(memory_format=torch.channels_last)
    pool = camera_pool(recipe, network, workers.device, progress)
    return Setup(recipe, camera, system, training_data, sampling, workers.device, history, auxiliary, pool)


def _check_varying(recipe: TrainRecipe, camera: CameraRecipe, network: Restorer) -> None:
    """Raises InputError for what asks for one set of PSFs, where a lens has others at each place."""
    problems = []
    if network.psfs != "none":
        problems.append(
            f"network.kind = {network.kind!r} is conditioned on one set of PSFs: train one that is not, such"
            ' as "local-unet"'
        )
    if recipe.doe.design_steps:
        problems.append("doe.design_steps design for one set of PSFs: leave them out")
    varies = f"the PSFs of the lens {camera.lens.kind!r} vary over the frame"
    if problems:
        raise InputError([f"{varies}, and {problem}" for problem in problems])


def build_mask(
    recipe: TrainRecipe, camera: CameraRecipe, base: Path
) -> tuple[nn.Module, float | None, CameraRecipe]:
    """(mask that learns or not, its sampling, the camera that photographs with its height map).

    A mask that is not a height map is turned into one, so that its fabrication can be simulated and its
    shape can learn. Masks that only block light stay with the camera.
    """
    optics = Camera.from_recipe(camera, base)
    mask = optics.mask
    pitch = (mask.pitch_um if isinstance(mask, HeightMapMask) else MASK_PITCH_UM) * 1e-6
    if not isinstance(mask, PhaseMask):
        return NoHeight(), None, camera
    wavelength = mask.design_wavelength_nm * 1e-9
    radian = metres_per_radian(float(optics.mask_material.index(wavelength)), wavelength)
    grid = PupilGrid(natural_samples(optics, pitch), pitch, optics.aperture_radius)
    plain = HeightMapMask(
        material=mask.material, design_wavelength_nm=mask.design_wavelength_nm, pitch_um=pitch * 1e6
    )
    learner = _learner(recipe, mask, optics, grid, radian)
    return learner, pitch, camera.model_copy(update={"mask": plain})


def camera_of(mask: nn.Module, camera: Camera) -> tuple[nn.Module, float | None, CameraRecipe]:
    """As `build_mask`, of a mask that gives maps [n, n] whose samples just cover the pupil. Raises InputError
    for what are none."""
    with torch.no_grad():
        height, amplitude = maps_of(mask)
    camera.with_height(height).with_amplitude(amplitude)
    if height is None and amplitude is None:
        raise InputError("the mask gives nothing: it is to give a height map [n, n] in metres")
    if height is None:
        return mask, None, camera.recipe
    pitch = 2 * camera.aperture_radius * (1 + 1e-12) / len(height)
    material = camera.mask.material if isinstance(camera.mask, PhaseMask) else HeightMapMask().material
    with_mask = HeightMapMask(pitch_um=pitch * 1e6, material=material)
    return mask, pitch, camera.recipe.model_copy(update={"mask": with_mask})


def _learner(recipe: TrainRecipe, mask: Mask, optics: Camera, grid: PupilGrid, radian: float) -> nn.Module:
    doe = recipe.doe
    limit = doe.height_limit_um * 1e-6
    if doe.start is not None:
        return _started(doe.start, recipe, optics, grid, radian)
    if isinstance(mask, HeightMapMask):
        given = None if mask.file is None else designed_map(optics)
        start = torch.full((grid.samples, grid.samples), limit / 2) if given is None else given[0]
        return _free("mask.file", start, recipe, radian) if doe.learn else FixedHeight(start)
    learner = mask.learner(grid, radian) if doe.learn else None
    if learner is not None:
        return learner
    if doe.learn and MASKS.of_another(mask.kind):
        raise InputError(
            f"the mask {mask.kind!r} of another package has no `learner`, so its parameters cannot learn: "
            "set "
            "doe.learn = false to keep it, or give its class a `learner`"
        )
    phase = asked(mask, "phase", lambda: mask.phase(grid))
    if phase is None:
        raise InputError(f"mask.kind = {mask.kind!r} has no phase to train with; choose another mask")
    return FixedHeight((phase - phase.min()) * radian)


def _started(source: str, recipe: TrainRecipe, optics: Camera, grid: PupilGrid, radian: float) -> nn.Module:
    """The height map of a checkpoint, to learn on or to keep."""
    named = f"doe.start = {source!r}"
    checkpoint = load_checkpoint(source, optics.recipe)
    if checkpoint.height is None or tuple(checkpoint.height.shape) != (grid.samples, grid.samples):
        raise InputError(f"{named}: this checkpoint has no height map of {grid.samples} samples across")
    if not recipe.doe.learn:
        return FixedHeight(checkpoint.height)
    if optics.mask.learner(grid, radian) is not None:
        raise InputError(
            f"{named}: a mask of kind {optics.mask.kind!r} learns by values of its own, which a height map "
            "does not tell; write those of the checkpoint's mask into [mask], or let each sample learn: "
            'kind = "height-map"'
        )
    return _free(named, checkpoint.height, recipe, radian)


def _free(named: str, height: Tensor, recipe: TrainRecipe, radian: float) -> FreeHeight:
    """A height map [n, n] in metres that learns on. Raises InputError where it is deeper than the recipe
    allows: held within that, it would be another mask."""
    limit_um, deepest_um = recipe.doe.height_limit_um, float(height.max()) * 1e6
    if deepest_um > limit_um * (1 + ROUNDING):
        raise InputError(
            f"{named}: this height map is {deepest_um:.3g} um deep; set doe.height_limit_um, which is "
            f"{limit_um:g}, to as much"
        )
    return FreeHeight(height, limit_um * 1e-6, radian)


def _network(recipe: TrainRecipe, camera: CameraRecipe) -> tuple[Restorer, tuple[Json, ...]]:
    """The network with weights that only the seed decides, or those of a checkpoint, and its history. What it
    does not have of one that grows out of it is the seed's, too."""
    table = recipe.network
    history: tuple[Json, ...] = ()
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(recipe.seed)
        if table.start is None:
            settings = network_class(table.kind).settings_for(table.settings, camera.psf.window_px)
            network = build_network(table.kind, settings)
        else:
            checkpoint = load_checkpoint(table.start, camera)
            network, history = checkpoint.network, tuple(history_of(checkpoint))
            other = {**network.settings(), **table.settings} != network.settings()
            if network.kind != table.kind or other:
                try:
                    network = network_class(table.kind).grown(network, table.settings)
                except InputError as error:
                    raise InputError(f"network.start = {table.start!r}: {error}") from None
    return network, history


def _with_auxiliary(
    recipe: TrainRecipe, camera: CameraRecipe, network: Restorer, height: Tensor | None
) -> tuple[Restorer, tuple[Json, ...]]:
    """The network with the auxiliary network that the recipe names, and the history of that.
    height: [n, n] in metres, of the training's mask, which is to be the checkpoint's, too."""
    source = recipe.network.auxiliary
    if source is None:
        return network, ()
    checkpoint = load_checkpoint(source, camera)
    if not _same(height, checkpoint.height):
        raise InputError(
            f"network.auxiliary = {source!r}: it was trained with another mask; name a checkpoint of this"
            " mask, or start with the mask of that one (doe.start)"
        )
    try:
        return network.with_auxiliary(checkpoint.network), tuple(history_of(checkpoint))
    except InputError as error:
        raise InputError(f"network.auxiliary = {source!r}: {error}") from None


def _same(height: Tensor | None, other: Tensor | None) -> bool:
    if height is None or other is None or height.shape != other.shape:
        return height is other
    return torch.allclose(height.cpu(), other, rtol=0, atol=SAME_HEIGHT)


def _camera(recipe: TrainRecipe, base: Path) -> tuple[CameraRecipe, Path]:
    """The camera with what the training recipe replaces, and the folder its own files are relative to."""
    loaded = load_camera(recipe.camera, base)
    changes: dict[str, object] = {"mask": recipe.mask, "psf": recipe.psf}
    given = {key: value for key, value in changes.items() if value is not None}
    camera = loaded.recipe.model_copy(update=given)
    return camera, base if recipe.mask is not None else loaded.base
