"""Learning in Python: any network, mask, loss and data of PyTorch, by the loop of the command `train`."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean

import torch
from torch import Tensor, nn

from ..capture.planes import truncated_light
from ..core.progress import Progress
from ..errors import InputError
from ..optics import PAPER_COLOURS, Camera
from ..recipe.load import Loaded, load_camera
from ..recipe.toml import validate
from ..recipe.train import TrainRecipe
from ..restore import choose_network, restore
from ..restore.checkpoint import Checkpoint
from ..restore.own_network import OwnNetwork
from ..restore.restorer import Restorer
from ..restore.scores import Score, score
from .doe import FixedHeight
from .own_data import PairSource, dataset_images
from .photographs import NaturalImages, PackagedImages, plane_source
from .reader import Source
from .schedule import generator_of
from .setup import Given
from .sources import packaged_images, read_folder
from .system import Draw, recorded
from .trainer import TEST_NOISE, VALIDATION, Trained, train
from .training_camera import TrainingCamera

Range = tuple[float, float]


def fit(
    camera: Camera | str | Path,
    network: nn.Module,
    data: object = None,
    *,
    mask: nn.Module | None = None,
    loss: Callable[[Tensor, Tensor], Tensor] | None = None,
    settings: Mapping[str, object] | None = None,
    steps: int = 1000,
    batch: int = 4,
    patch_px: int = 128,
    inverse_depth_per_m: Range = (0.0, 2.0),
    read_noise: Range = (0.001, 0.015),
    height_noise: float = 40e-9,
    learning_rate: float = 1e-3,
    mask_learning_rate: float = 5e-3,
    precision: str = "auto",
    out: str | Path = "out/fit",
    seed: int = 0,
    device: str = "auto",
    resume: bool = False,
    progress: Progress | None = None,
) -> Trained:
    """Let a network, and a mask with it, learn to restore photos; both change in place.

    camera: one, a shipped one by name, or a recipe.
    network: from photos [batch, 3, y, x], full scale 1, to images of the same shape.
    data: a folder of pictures; a `Dataset` of images [3, y, x], the same each time, or the one of a
        `DataLoader`; one of pairs, such as `edofsim.data.Pairs`, from which no mask learns; None for the
        photographs of scikit-image.
    mask: gives a height map [n, n] in metres that just covers the pupil, or a dict of `height`, `amplitude`
        (`edofsim.camera`), or both; None keeps the camera's.
    loss: of restored and ideal images [batch, 3, y, x]; None for the paper's.
    settings: what the network's class is called with to build such a one, for the checkpoint; None for its
        attributes of the same names.
    steps, batch, patch_px: of the training; patches have this side in pixels.
    inverse_depth_per_m, read_noise: ranges that each patch draws from, 1/m and parts of full scale.
    height_noise: standard deviation of the mask's error of making, drawn in each step, metres.
    learning_rate, mask_learning_rate: of Adam, for the network's weights and the mask's values.
    precision: of the network, `float32`, `bfloat16` or `auto`.
    out: folder of the checkpoint, the state, the log and pictures.
    resume: go on from the state in it.
    device: `auto`, `cpu` or `cuda`; under `torchrun` each process takes its share of a batch.
    seed: of all that is drawn.
    progress: is called with the part that is done, 0 to 1, and what is being done.

    Figures: psnr_db.start and psnr_db.validation are of the same photos, before and after. Raises InputError
    for what cannot be used.
    """
    camera = _camera(camera)
    if not isinstance(network, nn.Module):
        raise InputError(f"network is a {type(network).__name__}: give a torch.nn.Module")
    own = network if isinstance(network, Restorer) else OwnNetwork.around(network, settings)
    table = {
        "name": re.sub(r"[^A-Za-z0-9]+", "-", Path(out).resolve().name).strip("-")[:64] or "fit",
        "camera": f"{camera.recipe.name} {hashlib.sha256(camera.key().encode()).hexdigest()[:12]}",
        "seed": seed,
        "network": {"kind": own.kind, "settings": own.settings()},
        "doe": {
            "learn": mask is not None,
            "learning_rate_rad": 0.0 if mask is None else mask_learning_rate,
            "height_noise_nm": height_noise * 1e9,
        },
        "data": {"patch_px": patch_px, "sources": [{"kind": "packaged" if data is None else "natural"}]},
        "capture": {"inverse_depth_per_m": inverse_depth_per_m, "read_noise": read_noise},
        "optimiser": {
            "steps": steps,
            "batch": batch,
            "learning_rate": learning_rate,
            "precision": precision,
        },
    }
    recipe = validate(TrainRecipe, table)
    source = _source(data, recipe, camera.recipe.psf.window_px)
    if mask is not None and isinstance(source, PairSource):
        raise InputError(
            "data: these photos were taken already, and no mask can learn from them: give images"
        )
    if mask is None and camera.mask_given:
        fixed = camera.without_gradients()
        mask = FixedHeight(fixed.height_map, fixed.amplitude)
    given = Given(camera, own, mask, loss and _checked(loss, patch_px), source)
    loaded = Loaded(recipe, camera.base / "fit.toml", "")
    return train(loaded, Path(out), resume=resume, device=device, progress=progress, given=given)


@dataclass(frozen=True)
class Evaluation:
    """scores, photo_scores: of each restored image and its photo against the ideal image."""

    scores: tuple[Score, ...]
    photo_scores: tuple[Score, ...]

    @property
    def psnr_db(self) -> float:
        """Mean over the images, dB."""
        return fmean(each.psnr_db for each in self.scores)

    @property
    def ssim(self) -> float:
        """Mean over the images."""
        return fmean(each.ssim for each in self.scores)

    @property
    def photo_psnr_db(self) -> float:
        """Mean over the photos, dB."""
        return fmean(each.psnr_db for each in self.photo_scores)


@torch.no_grad()
def evaluate(
    network: nn.Module | str | Path | None,
    camera: Camera | str | Path,
    data: object = None,
    *,
    count: int = 16,
    patch_px: int = 256,
    inverse_depth_per_m: Range = (0.0, 2.0),
    read_noise: float = TEST_NOISE,
    seed: int = 0,
) -> Evaluation:
    """PSNR and SSIM of what a network restores, as it is used, from photos of planes at depths evenly spread.

    network: a module; a checkpoint, whose mask the camera is given, by file or shipped name; `wiener`; None
        for the one that belongs to the camera.
    data: as for `fit`.
    count: patches of `patch_px` pixels, the middles of its images.
    camera: one, a shipped one by name, or a recipe.
    patch_px: side of a patch.
    inverse_depth_per_m: least and largest, 1/m.
    read_noise: standard deviation, relative to full scale, in place of the sensor's own.
    seed: of the noise.

    Raises InputError for what cannot be used.
    """
    camera = _camera(camera)
    training = isinstance(network, nn.Module) and network.training
    if isinstance(network, nn.Module):
        own = network if isinstance(network, Restorer) else OwnNetwork(type(network).__name__, {}, network)
        checkpoint = Checkpoint(own, None, None, {"name": type(network).__name__})
    else:
        checkpoint, camera = choose_network(network, Loaded(camera.recipe, camera.base / "camera.toml", ""))
    capture = {"inverse_depth_per_m": inverse_depth_per_m, "read_noise": (read_noise, read_noise)}
    table = {"name": "evaluate", "camera": camera.recipe.name, "data": {"patch_px": patch_px}, "seed": seed}
    recipe = validate(TrainRecipe, {**table, "capture": capture})
    optics = TrainingCamera(camera, camera.recipe.psf.window_px, torch.device("cpu"))
    depths = torch.tensor(inverse_depth_per_m, dtype=torch.float64)
    scores: list[Score] = []
    photos: list[Score] = []
    for index, scenes in enumerate(_source(data, recipe, optics.window, whole=True).validation(count)):
        captured = scenes.photograph(optics)
        draw = Draw(scenes, torch.tensor([read_noise]), generator_of(seed, VALIDATION, index, 0))
        photos_seen = recorded(captured, draw, camera)
        for k, (photo, ideal) in enumerate(zip(photos_seen, captured.ideal, strict=True)):
            lost = None if captured.psf is None else truncated_light(captured.psf[k][None])[0]
            how = {"checkpoint": checkpoint, "truncated": lost}
            scores.append(score(restore(photo, camera, PAPER_COLOURS, depths, **how)[0], ideal))
            photos.append(score(photo, ideal))
    if isinstance(network, nn.Module):
        network.train(training)
    return Evaluation(tuple(scores), tuple(photos))


def _camera(camera: Camera | str | Path) -> Camera:
    if isinstance(camera, Camera):
        return camera
    loaded = load_camera(camera)
    return Camera.from_recipe(loaded.recipe, loaded.base)


def _source(data: object, recipe: TrainRecipe, window: int, *, whole: bool = False) -> Source:
    """What data are, a part of them held back; whole: all are trained and validated on."""
    patch = recipe.data.patch_px
    if data is None:
        table, images, name = PackagedImages(), packaged_images(patch), "skimage.data"
    elif isinstance(data, str | Path):
        table, images, name = NaturalImages(), read_folder(Path(data), patch), Path(data).name
    else:
        table, images, name = NaturalImages(), dataset_images(data, patch), type(data).__name__
    source = plane_source(table, images, name, recipe, window, whole=whole)
    if images.pictures[0].shape[0] == 3:
        return source
    return PairSource(source.training, source.held_back, patch, source.described, source.sha256)


def _checked(loss: Callable[[Tensor, Tensor], Tensor], patch_px: int) -> Callable[[Tensor, Tensor], Tensor]:
    found = loss(*torch.rand(2, 1, 3, patch_px, patch_px))
    if isinstance(found, Tensor) and found.ndim == 0:
        return loss
    said = list(found.shape) if isinstance(found, Tensor) else type(found).__name__
    raise InputError(f"loss gives {said} for two images: it is to give one number, a tensor without axes")
