"""The systems of the paper's comparisons: an aperture with what restores its photos."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from torch import Tensor

from ..core.json_values import Json
from ..errors import InputError
from ..optics import PAPER_COLOURS, Camera
from ..optics.nodes import node_shares, nodes_between
from ..recipe.camera import CameraRecipe
from ..recipe.fabrication import Fabrication
from ..recipe.load import load_camera
from ..restore.checkpoint import (
    camera_with_mask,
    comparison_checkpoints,
    find_checkpoint,
    load_checkpoint,
    shipped_checkpoints,
    trained_camera,
)
from ..restore.conditioning import conditioned_on
from ..restore.light import without_glare
from ..restore.network import apply_network
from ..restore.restore import channel_psfs
from ..restore.wiener import wiener
from .protocols import of_three_lines

READ_NOISE = 0.005
NEAREST_PER_M = 2.0
WITHOUT_TRAINING = ("paper-clear", "paper-cubic")


@dataclass(frozen=True)
class Contestant:
    """A system. camera: with the mask as designed; restore: a photo [3, y, x] and the part of its light that
    is veiling glare [3] to [3, y, x], as everybody's photos are restored; digest: SHA-256 of what it consists
    of; training: None where nothing was trained."""

    name: str
    camera: Camera
    restore: Callable[[Tensor, Tensor], Tensor]
    digest: str
    training: Training | None = None


@dataclass(frozen=True)
class Training:
    """What a card tells of how long a system was trained. steps: with its own mask, all its trainings
    together; before: steps of another system, from whose weights it started; hours: of the own steps, None
    where the card does not say of all."""

    steps: int
    before: int
    hours: float | None


def training_of(card: Json) -> Training:
    """By a checkpoint's card (see `restore.checkpoint`)."""
    every = [*card.get("history", ()), card]
    own = [entry for entry in every if entry.get("name") == card.get("name")]
    steps = sum(int(entry.get("step", 0)) for entry in own)
    hours = sum(entry["hours"] for entry in own) if all("hours" in entry for entry in own) else None
    return Training(steps, sum(int(entry.get("step", 0)) for entry in every) - steps, hours)


def contestants(names: Sequence[str | Path] | None, *, every: bool = False) -> list[Contestant]:
    """Systems by name or file; None for all that ship, with the clear and the cubic aperture, and with
    `every` also those that were trained for comparison.

    Raises InputError for what is neither, and for two systems of one name."""
    trained = shipped_checkpoints() | (comparison_checkpoints() if every else {})
    found = [contestant(name) for name in names or (*trained, *WITHOUT_TRAINING)]
    known = [system.name for system in found]
    twice = sorted({name for name in known if known.count(name) > 1})
    if twice:
        raise InputError(f"two systems are called {twice[0]!r}; evaluate them one at a time, in two --out")
    return found


def contestant(source: str | Path, wavelengths: Tensor | None = None) -> Contestant:
    """A system from a checkpoint, or from a shipped camera by name with Wiener deconvolution.

    wavelengths: [band] in metres, that the sensor adds up to its colours, as filters know them; None for the
    three of the paper's training. Raises InputError for what is neither.
    """
    if str(source) in WITHOUT_TRAINING:
        recipe = load_camera(source).recipe
        camera = Camera.from_recipe(recipe)
        nodes, stack = standing_psfs(camera, wavelengths)
        digest = hashlib.sha256(recipe.model_dump_json().encode() + stack.numpy().tobytes()).hexdigest()
        name = f"{source}+wiener"
        return Contestant(name, camera, lambda photo, glare: filtered(photo, stack, glare, nodes), digest)
    checkpoint = load_checkpoint(source)
    if checkpoint.network.any_camera:
        raise InputError(f"{source} is for any camera and has no mask; `edofsim evaluate cameras` judges it")
    recipe = trained_camera(checkpoint).model_copy(update={"psf": CameraRecipe(name="default").psf})
    camera = camera_with_mask(recipe, checkpoint)
    digest = hashlib.sha256(find_checkpoint(source).read_bytes()).hexdigest()
    network = checkpoint.network
    if wavelengths is not None:
        network = conditioned_on(checkpoint, camera, wavelengths)
    return Contestant(
        checkpoint.name,
        camera,
        lambda photo, glare: apply_network(network, photo, glare=glare),
        digest,
        training_of(checkpoint.card),
    )


def made(camera: Camera, fabrication: Fabrication) -> Camera:
    """The camera with its mask as it is made. Masks without relief have nothing to make."""
    if not hasattr(camera.recipe.mask, "design_wavelength_nm"):
        return camera
    return replace(camera, recipe=camera.recipe.model_copy(update={"fabrication": fabrication}))


def paper_test(seed: int) -> Fabrication:
    """A mask as the paper tests it: at 3 um, with a height error of 30 nm."""
    return Fabrication(preset="paper-test", seed=fabrication_seed(seed))


def fabrication_seed(seed: int) -> int:
    """The 31 bits of a seed that a fabrication has."""
    return seed % 2**31


def standing_psfs(
    camera: Camera, wavelengths: Tensor | None = None, nearest_per_m: float = NEAREST_PER_M
) -> tuple[Tensor, Tensor]:
    """What a filter knows: inverse depths [depth] in 1/m from 0 to `nearest_per_m` (see `nodes_between`), and
    PSFs [depth, 3, y, x] there, of the mask as designed. wavelengths: see `contestant`."""
    bands = PAPER_COLOURS if wavelengths is None else wavelengths
    seen = camera if wavelengths is not None else of_three_lines(camera)
    nodes = nodes_between(seen, bands, 0.0, nearest_per_m)
    return nodes, channel_psfs(seen, bands, nodes)


def described(fabrication: Fabrication) -> str:
    """A fabrication as text, for keys."""
    return json.dumps(fabrication.model_dump(mode="json"), sort_keys=True)


def filtered(photo: Tensor, stack: Tensor, glare: Tensor, nodes: Tensor | None = None) -> Tensor:
    """A photo [3, y, x], of whose light the part `glare` [3] is veiling glare, after Wiener deconvolution by
    PSFs [depth, 3, y, x] at inverse depths `nodes` [depth] (None: all equally likely), in [0, 1]."""
    within = (stack / stack.sum((-1, -2), keepdim=True)).to(photo)
    shares = None if nodes is None else node_shares(nodes)
    return wiener(without_glare(photo, glare), within, READ_NOISE, shares=shares).clamp(0, 1)


def truncated_share(psf: Tensor) -> Tensor:
    """The part of the light that the window of PSFs [.., y, x] truncates, [..]: it is veiling glare. That
    of a made mask is nearly the same whatever its errors are drawn like: how finely it is made decides it,
    which is known of a camera."""
    return 1 - psf.sum((-1, -2))
