"""One call from a photo to a sharp image, whichever way."""

from __future__ import annotations

import torch
from torch import Tensor

from ..optics import Camera, psf_bank, response
from .checkpoint import Checkpoint
from .conditioning import conditioned_on, refusal
from .light import without_glare, without_truncated
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
    psfs: Tensor | None = None,
    glare: Tensor | None = None,
    truncated: Tensor | None = None,
) -> tuple[Tensor, str]:
    """The sharp image of a photo, and what made it, in words.

    image: [channel, y, x] linear, full scale 1. Without a checkpoint, Wiener deconvolution for the
    wavelengths [band] in metres and the inverse depths [depth] in 1/m that the photo may hold, each depth
    equally likely. A filter bank is conditioned on the wavelengths, see `conditioning`; where a network for
    any camera cannot restore, Wiener deconvolution does, and the words say why. psfs: `channel_psfs` of
    these wavelengths and depths, None where they are still to be made. glare: [channel], the part of the
    light that is spread evenly over the photo besides what the camera's own PSFs lack: by a mask that was
    made otherwise; truncated: [channel], the part that leaves the windows of the PSFs, where that is known
    (`Photo.truncated`), None for that of the camera's PSFs at the mean depth.
    """
    glare = torch.zeros(len(image)) if glare is None else glare
    why = None if checkpoint is None else refusal(checkpoint, camera)
    if checkpoint is None or why is not None:
        psf = channel_psfs(camera, wavelengths, inverse_depths) if psfs is None else psfs
        linear = wiener(without_glare(image, glare), psf.to(image), camera.read_noise)
        return linear, f"Wiener, as {why}" if why else "Wiener"
    network = conditioned_on(checkpoint, camera, wavelengths, inverse_depths)
    if truncated is None:
        lens = channel_psfs(camera, wavelengths, inverse_depths.double().mean()[None])
        truncated = 1 - lens.sum((-1, -2))[0]
    glare = 1 - (1 - glare) * (1 - truncated.to(glare))
    if not network.any_camera:
        return apply_network(network, image, glare=glare), checkpoint.name
    psf = channel_psfs(camera, wavelengths, inverse_depths) if psfs is None else psfs
    return for_any_camera(network, image, psf.to(image), camera.read_noise, glare), checkpoint.name


def for_any_camera(network: Restorer, image: Tensor, psf: Tensor, noise: float, glare: Tensor) -> Tensor:
    """What a network for any camera that was told this one makes of a photo [channel, y, x], with its share
    of Wiener deconvolution, in [0, 1]. psf, noise: of `deconvolved`; glare: [channel], all that is spread
    evenly over the photo."""
    light = without_glare(image, glare)
    linear = deconvolved(light, psf, noise)
    return apply_network(network, light, linear=linear).lerp(linear.clamp(0, 1), network.linear_share())


def deconvolved(photo: Tensor, psf: Tensor, noise: float) -> Tensor:
    """Wiener deconvolution of photos [.., channel, y, x] without glare by PSFs [depth, channel, y, x], whose
    depths are equally likely. noise: standard deviation before the glare was taken off."""
    return wiener(photo, *without_truncated(psf, noise))


def channel_psfs(camera: Camera, wavelengths: Tensor, inverse_depths: Tensor) -> Tensor:
    """PSFs as the sensor's channels see a white point, [depth, channel, y, x]: the bands of the bank
    weighted with the response."""
    bank = psf_bank(camera, wavelengths, inverse_depths)
    weights = response(camera, wavelengths).to(bank.values)
    return torch.einsum("cb,dbyx->dcyx", weights, bank.values)
