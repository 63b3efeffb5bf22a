"""Wiener deconvolution as a restorer that is trained with its mask and shipped in a checkpoint."""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn

from .wiener import wiener


class WienerNetwork(nn.Module):
    """The filter of `wiener.wiener` for the PSFs of a mask, with a noise level that learns.

    The masks of Cubic (Dowski and Cathey, 1995) and of Sitzmann et al. (2018) are restored so. window: width
    of the PSFs in pixels; depths: how many PSFs, over the depth range, stand for all.
    """

    kind = "wiener"
    radius: int | None = None  # every output pixel sees the whole photo
    multiple = 1

    def __init__(self, window: int = 128, depths: int = 9) -> None:
        super().__init__()
        self.window, self.depths = window, depths
        self.log_noise = nn.Parameter(torch.tensor(math.log(0.01)))
        psf = torch.zeros(depths, 3, window, window)
        psf[..., window // 2, window // 2] = 1  # no blur, until a mask is known
        self.psf: Tensor
        self.register_buffer("psf", psf)

    def settings(self) -> dict[str, int]:
        """What rebuilds this restorer."""
        return {"window": self.window, "depths": self.depths}

    def forward(self, photo: Tensor, psf: Tensor | None = None) -> Tensor:
        """Photo [batch, 3, y, x] to the sharp image. psf: [depth, 3, window, window] in place of its own,
        while the mask learns. Clamped to [0, 1] except in training."""
        psf = self.psf if psf is None else psf
        with torch.autocast(photo.device.type, enabled=False):
            images = [wiener(image.float(), psf, self.log_noise.exp()) for image in photo]
        sharp = torch.stack(images)
        return sharp if self.training else sharp.clamp(0, 1)
