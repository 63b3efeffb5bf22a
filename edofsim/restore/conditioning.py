"""A bank of filters conditioned on a camera: on how it blurs the bands of a photo.

A checkpoint's bank knows the PSFs of the wavelengths that it was trained with. Where the sensor adds up many
bands its colours are blurred otherwise: what three lines draw finely, 31 bands smear. The filters and the
likelihood follow from the PSFs in closed form, so that they are computed anew for the camera's response; what
was trained stays.
"""

from __future__ import annotations

import copy
from weakref import WeakKeyDictionary

import torch
from pydantic import ValidationError
from torch import Tensor

from ..capture.sensor import noise_deviation
from ..errors import InputError
from ..optics import Camera, channel_psfs, response, response_curves
from ..optics import cache as bank_cache
from ..optics.sampling import coarsest_pitch
from ..recipe.camera import CameraRecipe
from ..recipe.train import TrainRecipe
from . import kept_state
from .checkpoint import Checkpoint, recipe_with_mask, trained_camera
from .depths import closer_about_focus
from .photograph_statistics import colour_weights
from .restorer import Restorer

WIDEST_PX = 512
"""Of PSFs for the network for any camera: more would fill the memory."""
ENOUGH = 10
"""Bands: of more, neighbours are taken together, but for a network that sees by colour."""

# by the network of the checkpoint: computing one takes seconds, and scenes come with the same bands
_CONDITIONED: WeakKeyDictionary[Restorer, dict[tuple[object, ...], Restorer]] = WeakKeyDictionary()


def conditioned_on(
    checkpoint: Checkpoint, camera: Camera, wavelengths: Tensor, inverse_depths: Tensor | None = None
) -> Restorer:
    """The checkpoint's network for photos that `camera` takes of bands `wavelengths` [band], metres.

    wavelengths: [band], metres.
    inverse_depths: [depth], 1/m.

    A network for any camera is set for this one: its PSFs between the least and the largest of inverse_depths
    [depth] in 1/m, by the mask as it is made, and its read noise.

    A network that was conditioned on mean PSFs gets those of the response; other networks, and all for a
    sensor whose colours are a wavelength each, come back as they are. The mask is the checkpoint's as
    designed, with the mean error of its training, whatever the camera's own fabrication. Raises InputError
    where PSFs or response cannot be computed.
    """
    network = checkpoint.network
    if network.any_camera:
        assert inverse_depths is not None
        return _conditioned(network, camera, wavelengths, inverse_depths)
    if network.psfs != "mean" or response_curves(camera) is None:
        return network
    weights = response(camera, wavelengths)
    known = _CONDITIONED.setdefault(network, {})
    recipe = camera.recipe.model_dump_json(include={"lens", "focus", "sensor"})
    key = (recipe, *weights.flatten().tolist(), *wavelengths.tolist())
    if key not in known:
        conditioned = copy.deepcopy(network).cpu()
        depths = network.psf_depths(_training(checkpoint).capture.inverse_depth_per_m)
        if network.colour_psfs:
            seen = wavelengths.double().cpu(), colour_weights(wavelengths, weights)
        else:
            seen = _enough(wavelengths, weights)
        _set_psfs(conditioned, checkpoint, camera, *seen, depths)
        known[key] = conditioned
    return known[key]


def refusal(checkpoint: Checkpoint, camera: Camera) -> str | None:
    """Why a checkpoint for any camera cannot restore photos of this one, the end of a sentence; None where it
    can, and for other checkpoints."""
    window = camera.recipe.psf.window_px
    if not checkpoint.network.any_camera or window <= WIDEST_PX:
        return None
    return f"the window of the camera's PSFs has {window} pixels, and {checkpoint.name} takes {WIDEST_PX}"


def _conditioned(network: Restorer, camera: Camera, wavelengths: Tensor, inverse_depths: Tensor) -> Restorer:
    """A network for any camera, for this one."""
    wavelengths, inverse_depths = wavelengths.double().cpu(), inverse_depths.double().cpu()
    low, high = (float(end) for end in inverse_depths.aminmax())
    depths = closer_about_focus(camera, network.psf_depths((low, high)))
    window = camera.recipe.psf.window_px
    known = _CONDITIONED.setdefault(network, {})
    weights = response(camera, wavelengths)
    bank = bank_cache.key(camera, wavelengths, depths, window, None, torch.float32)
    key = (bank, *weights.flatten().tolist(), noise_deviation(camera))
    if key not in known:
        conditioned, (some, of_each) = copy.deepcopy(network).cpu(), _enough(wavelengths, weights)

        def psfs() -> Tensor:
            return channel_psfs(camera, some, depths, weights=of_each)

        kept_state.set_camera(conditioned, camera, (some, of_each, depths), psfs, noise_deviation(camera))
        known[key] = conditioned
    return known[key]


def _enough(wavelengths: Tensor, weights: Tensor) -> tuple[Tensor, Tensor]:
    """Wavelengths [n] that stand for all of wavelengths [band], and the colours' weights [channel, n] of
    those next to them; weights: [channel, band]."""
    groups = torch.arange(len(wavelengths)).split(max(1, len(wavelengths) // ENOUGH))
    middles = torch.stack([few[len(few) // 2] for few in groups])
    return wavelengths[middles], torch.stack([weights[:, few].sum(1) for few in groups], 1)


def forget() -> None:
    """Empty the memory of such networks, for timings."""
    _CONDITIONED.clear()


def _set_psfs(
    network: Restorer,
    checkpoint: Checkpoint,
    camera: Camera,
    wavelengths: Tensor,
    weights: Tensor,
    inverse: Tensor,
) -> None:
    """Give it those of its mask at inverse depths [depth] in 1/m."""
    window = trained_camera(checkpoint).psf.window_px
    # the training's sampling of the pupil may be too coarse for the shortest wavelengths; the coarsest that
    # they allow is fine enough for filters
    psf = CameraRecipe(name="default").psf
    recipe = recipe_with_mask(camera.recipe, checkpoint).model_copy(update={"fabrication": None, "psf": psf})
    coarsest = coarsest_pitch(Camera.from_recipe(recipe, camera.base), wavelengths, inverse, window)
    psf = psf.model_copy(update={"pupil_sampling_um": coarsest * 1e6})
    own = Camera.from_recipe(recipe.model_copy(update={"psf": psf}), camera.base)
    own, error = own.with_amplitude(checkpoint.amplitude), 0.0
    if checkpoint.height is not None:
        own = own.with_height(checkpoint.height)
        error = _training(checkpoint).doe.height_noise_nm * 1e-9
    how = {"weights": weights, "height_noise": error, "window_px": window}
    axes = (wavelengths, weights, inverse, torch.tensor([error, window], dtype=torch.float64))
    channels = (3, 3) if network.colour_psfs else (3,)

    def psfs() -> Tensor:
        return channel_psfs(own, wavelengths, inverse, **how).unflatten(1, channels)

    kept_state.set_psfs(network, own, axes, psfs)


def _training(checkpoint: Checkpoint) -> TrainRecipe:
    try:
        return TrainRecipe.model_validate(checkpoint.card["recipe"])
    except (KeyError, ValidationError):
        raise InputError(
            f"{checkpoint.path}: its card names no recipe of a training, which its network needs for "
            "another response than it was trained with; train the checkpoint again"
        ) from None
