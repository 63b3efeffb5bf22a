"""Wiener deconvolution as a restorer that is trained with its mask and shipped in a checkpoint."""

from __future__ import annotations

import math
from collections.abc import Mapping

import torch
from torch import Tensor, nn

from .linear import wiener_error
from .restorer import Restorer
from .wiener import wiener

FALL = 2.0
"""Power of the frequency with which scenes' spectra fall: the noise that ships was learned with it."""


class WienerNetwork(Restorer):
    """The filter of `wiener.wiener` for the PSFs of a mask, with a noise level that learns.

    The masks of Cubic (Dowski and Cathey, 1995) and of Sitzmann et al. (2018) are restored so.

    window: width of the PSFs in pixels.
    depths: how many PSFs, over the depth range, stand for all.
    """

    kind = "wiener"
    psfs = "designed"

    def __init__(self, window: int = 128, depths: int = 9) -> None:
        super().__init__()
        self.window, self.depths = window, depths
        self.log_noise = nn.Parameter(torch.tensor(math.log(0.01)))
        psf = torch.zeros(depths, 3, window, window)
        psf[..., window // 2, window // 2] = 1  # no blur, until a mask is known
        self.psf: Tensor
        self.register_buffer("psf", psf)

    @classmethod
    def settings_for(cls, settings: Mapping[str, object], window_px: int) -> dict[str, object]:
        return {"window": window_px, **settings}

    def settings(self) -> dict[str, object]:
        return {"window": self.window, "depths": self.depths}

    def forward(self, photo: Tensor, psf: Tensor | None = None) -> Tensor:
        """Photo [batch, 3, y, x] to the sharp image.

        photo: [batch, 3, y, x], full scale 1.
        psf: [depth, 3, window, window] in place of its own, while the mask learns. Clamped to [0, 1] except
            in training.
        """
        sharp = self.unclamped(photo, psf)
        return sharp if self.training else sharp.clamp(0, 1)

    def unclamped(self, photo: Tensor, psf: Tensor | None = None) -> Tensor:
        """The same without the clamp.

        photo: [batch, 3, y, x], full scale 1.
        psf: [depth, 3, window, window] in place of its own.
        """
        psf = self.psf if psf is None else psf
        with torch.autocast(photo.device.type, enabled=False):
            images = [wiener(image.float(), psf, self.log_noise.exp(), fall=FALL) for image in photo]
        return torch.stack(images)

    def restored_with(self, photo: Tensor, psf: Tensor) -> Tensor:
        return self(photo, psf)

    def psf_depths(self, depth_range: tuple[float, float]) -> Tensor:
        return torch.linspace(*depth_range, self.depths, dtype=torch.float64)

    def set_psfs(self, psf: Tensor) -> None:
        self.psf.copy_(psf)

    def linear_error(self, psf: Tensor, filters: int) -> Tensor:
        return wiener_error(psf)
