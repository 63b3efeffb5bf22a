"""What restores a photo, where the user names it or leaves it open."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import torch
from torch import Tensor

from ..optics import Camera
from ..recipe import CameraRecipe, Loaded
from .checkpoint import Checkpoint, camera_with_mask, load_checkpoint, network_of
from .restore import restore

WIENER = "wiener"
"""In place of a checkpoint: Wiener deconvolution, whatever the camera."""


def choose_network(
    network: str | Path | None, camera: Loaded[CameraRecipe]
) -> tuple[Checkpoint | None, Camera]:
    """What restores (None: Wiener deconvolution), and the camera with the mask that it was trained with.

    network: checkpoint (file or shipped name); `wiener` for Wiener deconvolution; None for the network that
    was trained with the camera's mask, or Wiener deconvolution where there is none. Raises InputError for a
    checkpoint that is damaged or of another camera.
    """
    checkpoint = None
    if network is None:
        checkpoint = network_of(camera)
    elif network != WIENER:
        checkpoint = load_checkpoint(network, camera.recipe)
    if checkpoint is None:
        return None, Camera.from_recipe(camera.recipe, camera.base)
    return checkpoint, camera_with_mask(camera.recipe, checkpoint, camera.base)


def restoring(
    camera: Camera, wavelengths: Tensor, inverse_depth: Tensor, checkpoint: Checkpoint | None
) -> Callable[[Tensor, Tensor | None], Tensor]:
    """What restores photos of a scene: from a photo [channel, y, x] and `Photo.truncated`. wavelengths:
    [band]; inverse_depth: of all that the photo may show."""
    depths = depths_between(*inverse_depth.aminmax())
    return lambda photo, truncated: restore(
        photo, camera, wavelengths, depths, checkpoint=checkpoint, truncated=truncated
    )[0]


def depths_between(far: Tensor | float, near: Tensor | float, count: int = 9) -> Tensor:
    """Inverse depths that stand for a scene, equally spaced over what it spans, [depth]."""
    return torch.linspace(float(far), float(near), 1 if far == near else count)
