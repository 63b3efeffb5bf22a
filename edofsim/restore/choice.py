"""What restores a photo, where the user names it or leaves it open."""

from __future__ import annotations

from pathlib import Path

from ..optics import Camera
from ..recipe import CameraRecipe, Loaded
from .checkpoint import (
    ANY_CAMERA,
    Checkpoint,
    any_camera_checkpoints,
    camera_with_mask,
    network_of,
    read_once,
)
from .places import Method

WIENER = "wiener"
"""In place of a checkpoint: Wiener deconvolution, whatever the camera."""


def choose_network(
    network: str | Path | None, camera: Loaded[CameraRecipe]
) -> tuple[Checkpoint | None, Camera]:
    """What restores (None: Wiener deconvolution), and the camera with the mask that it was trained with.

    network: checkpoint (file or shipped name); `wiener` for Wiener deconvolution; None for `usual_network`.

    Raises InputError for a checkpoint that is damaged or of another camera.
    """
    checkpoint = None
    if network is None:
        checkpoint = usual_network(camera)
    elif network != WIENER:
        checkpoint = read_once(network, camera.recipe)
    if checkpoint is None:
        return None, Camera.from_recipe(camera.recipe, camera.base)
    return checkpoint, camera_with_mask(camera.recipe, checkpoint, camera.base)


def usual_network(camera: Loaded[CameraRecipe]) -> Checkpoint | None:
    """The network that was trained with the camera's mask, or where there is none the one that ships for any
    camera; None where that is missing. Raises InputError for a damaged checkpoint."""
    return network_of(camera) or any_camera_network()


def any_camera_network() -> Checkpoint | None:
    """The network that ships for any camera, read once; None where it is missing."""
    path = any_camera_checkpoints().get(ANY_CAMERA)
    return None if path is None else read_once(path)


def said_of(checkpoint: Checkpoint | None, by: Method) -> str | None:
    """Sentences on what restored a photo where that was not trained for its camera, and on what was taken off
    it first, for a person.

    by: as `restore` gives it; None where there is nothing to say.
    """
    said: list[str] = []
    if by.highlights:
        were = "1 highlight was" if by.highlights == 1 else f"{by.highlights} highlights were"
        said.append(f"{were} brighter than full scale; what is beyond was taken off before the restoration.")
    if checkpoint is not None and checkpoint.network.any_camera:
        said.append(
            f"Wiener deconvolution restored the photo: {by.reason}."
            if by.reason
            else f"No network was trained for this camera's mask: {by.name}, which knows any camera by its "
            "PSFs, restored the photo."
        )
    return " ".join(said) or None
