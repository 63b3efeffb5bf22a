"""One call from a photo to a sharp image, whichever way."""

from __future__ import annotations

import torch
from torch import Tensor

from ..optics import Camera, psf_bank, response
from .checkpoint import Checkpoint
from .conditioning import conditioned_on, refusal
from .light import without_glare
from .network import apply_network
from .restorer import Restorer
from .wiener import wiener


def restore(
    image: Tensor,
    camera: Camera,
    wavelengths: Tensor,
    inverse_depths: Tensor,
    *,
    checkpoint: Checkpoint | None = None,
    glare: Tensor | None = None,
    truncated: Tensor | None = None,
) -> tuple[Tensor, str]:
    """The sharp image of a photo, and what made it, in words.

    image: [channel, y, x] linear, full scale 1. Without a checkpoint, Wiener deconvolution for the
    wavelengths [band] in metres and the inverse depths [depth] in 1/m that the photo may hold, each depth
    equally likely. A filter bank is conditioned on the wavelengths, see `conditioning`; where a network for
    any camera cannot restore, Wiener deconvolution does, and the words say why. glare: [channel], the
    part of the light that is spread evenly over the photo besides what the camera's own PSFs lack: by a mask
    that was made otherwise; truncated: [channel], the part that leaves the windows of the PSFs, where that is
    known (`Photo.truncated`), None for that of the camera's PSFs at the mean depth.
    """
    glare = torch.zeros(len(image)) if glare is None else glare
    why = None if checkpoint is None else refusal(checkpoint, camera)
    linear = None
    if checkpoint is None or checkpoint.network.any_camera:
        psf = channel_psfs(camera, wavelengths, inverse_depths).to(image)
        linear = wiener(without_glare(image, glare), psf, camera.read_noise)
    if checkpoint is not None and why is None:
        network = conditioned_on(checkpoint, camera, wavelengths, inverse_depths)
        if truncated is None:
            lens = channel_psfs(camera, wavelengths, inverse_depths.double().mean()[None])
            truncated = 1 - lens.sum((-1, -2))[0]
        glare = 1 - (1 - glare) * (1 - truncated.to(glare))
        sharp = apply_network(network, image, glare=glare)
        return sharp if linear is None else with_share(network, sharp, linear), checkpoint.name
    assert linear is not None
    return linear, f"Wiener, as {why}" if why else "Wiener"


def with_share(network: Restorer, sharp: Tensor, linear: Tensor) -> Tensor:
    """What a network for any camera makes of a photo, with its share of Wiener deconvolution; both [channel,
    y, x], within [0, 1]."""
    return sharp.lerp(linear.clamp(0, 1), network.linear_share())


def channel_psfs(camera: Camera, wavelengths: Tensor, inverse_depths: Tensor) -> Tensor:
    """PSFs as the sensor's channels see a white point, [depth, channel, y, x]: the bands of the bank
    weighted with the response."""
    bank = psf_bank(camera, wavelengths, inverse_depths)
    weights = response(camera, wavelengths).to(bank.values)
    return torch.einsum("cb,dbyx->dcyx", weights, bank.values)
