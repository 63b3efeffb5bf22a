"""One call from a photo to a sharp image, whichever way."""

from __future__ import annotations

from pathlib import Path

import torch
from torch import Tensor

from ..optics import Camera, psf_bank, response
from .checkpoint import load_checkpoint
from .network import apply_network
from .wiener import wiener


def restore(
    image: Tensor,
    camera: Camera,
    wavelengths: Tensor,
    inverse_depths: Tensor,
    *,
    network: Path | None = None,
) -> tuple[Tensor, str]:
    """The sharp image of a photo, and what made it, in words.

    image: [channel, y, x] linear, full scale 1. wavelengths [band] in metres and inverse_depths [depth] in
    1/m are what the photo may hold; Wiener deconvolution (no network given) takes every depth as equally
    likely. network: a checkpoint. Raises InputError for a checkpoint of another camera.
    """
    if network is not None:
        checkpoint = load_checkpoint(network, camera.recipe)
        with torch.no_grad():
            return apply_network(checkpoint.network, image), f"{checkpoint.name} ({network.name})"
    psf = channel_psfs(camera, wavelengths, inverse_depths).to(image)
    return wiener(image, psf, camera.read_noise), "Wiener deconvolution"


def channel_psfs(camera: Camera, wavelengths: Tensor, inverse_depths: Tensor) -> Tensor:
    """PSFs as the sensor's channels see a white point, [depth, channel, y, x]: the bands of the bank
    weighted with the response."""
    bank = psf_bank(camera, wavelengths, inverse_depths)
    weights = response(camera, wavelengths).to(bank.values)
    return torch.einsum("cb,dbyx->dcyx", weights, bank.values)
