"""One call from a photo to a sharp image, whichever way."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import torch
from torch import Tensor

from ..optics import Camera, psf_bank, response
from .borders import continued
from .checkpoint import Checkpoint
from .network import apply_network
from .telling import told_network
from .wiener import wiener
from .wiener_network import WienerNetwork

BEYOND_PX = 4
"""A Wiener filter is given so much of what may lie beyond a photo, see `borders`, before mirror images go on.
Those alone leave lines on borders that bright things lie beyond. Farther out the slope foretells little, and
the filter of a lens without a mask, which raises some frequencies a lot, makes more of the guess."""


def restore(
    image: Tensor,
    camera: Camera,
    wavelengths: Tensor,
    inverse_depths: Tensor,
    *,
    checkpoint: Checkpoint | None = None,
) -> tuple[Tensor, str]:
    """The sharp image of a photo, and what made it, in words.

    image: [channel, y, x] linear, full scale 1. Without a checkpoint, Wiener deconvolution for the
    wavelengths [band] in metres and the inverse depths [depth] in 1/m that the photo may hold, each depth
    equally likely. A filter bank is told what the wavelengths look like, see `telling`.
    """
    if checkpoint is not None:
        network = told_network(checkpoint, camera, wavelengths)
        apply = partial(apply_network, network)
        with torch.inference_mode():
            sharp = _continued(apply, image) if isinstance(network, WienerNetwork) else apply(image)
        return sharp, checkpoint.name
    psf = channel_psfs(camera, wavelengths, inverse_depths).to(image)
    return _continued(partial(wiener, psf=psf, noise=camera.read_noise), image), "Wiener"


def _continued(filtered: Callable[[Tensor], Tensor], image: Tensor) -> Tensor:
    """What a Wiener filter makes of a photo that goes on a little with its slope."""
    sharp = filtered(continued(image, BEYOND_PX, turned=True))
    return sharp[..., BEYOND_PX:-BEYOND_PX, BEYOND_PX:-BEYOND_PX]


def channel_psfs(camera: Camera, wavelengths: Tensor, inverse_depths: Tensor) -> Tensor:
    """PSFs as the sensor's channels see a white point, [depth, channel, y, x]: the bands of the bank
    weighted with the response."""
    bank = psf_bank(camera, wavelengths, inverse_depths)
    weights = response(camera, wavelengths).to(bank.values)
    return torch.einsum("cb,dbyx->dcyx", weights, bank.values)
