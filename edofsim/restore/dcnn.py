"""The deblurring network of Akpinar et al. (their Sec. "Deblurring CNN")."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn.utils.fusion import fuse_conv_bn_eval

from .borders import continued
from .restorer import Restorer

DILATIONS = (1, 2, 3, 2, 1)
KERNELS = 32
LEAK = 0.01
RADIUS = sum(DILATIONS) + 1 + 2
"""Pixels that an output pixel sees around it."""


class DCnn(Restorer):
    """Five dilated convolution blocks estimate what the photo lacks; it is added, then refined and clamped.

    A block is a 3x3 convolution with 32 kernels, batch normalisation and a leaky ReLU; the dilations are
    1, 2, 3, 2, 1. A 3x3 convolution gives three channels, which are added to the photo; two transposed
    3x3 convolutions follow, and the clamp of Eq. `Clip`. 39,243 weights.

    The paper does not say how the weights start. The transposed convolutions start as the identity, so
    that the untrained network returns about its input and its clamp is not saturated.
    """

    kind = "dcnn"
    radius = RADIUS

    def __init__(self) -> None:
        super().__init__()
        layers: list[nn.Module] = []
        channels = 3
        for dilation in DILATIONS:
            layers += [
                nn.Conv2d(channels, KERNELS, 3, padding=dilation, dilation=dilation),
                nn.BatchNorm2d(KERNELS),
                nn.LeakyReLU(LEAK),
            ]
            channels = KERNELS
        layers.append(nn.Conv2d(channels, 3, 3, padding=1))
        self.residual = nn.Sequential(*layers)
        refine = [nn.ConvTranspose2d(3, 3, 3, padding=1) for _ in range(2)]
        for layer in refine:
            nn.init.dirac_(layer.weight)
            assert layer.bias is not None
            nn.init.zeros_(layer.bias)
        self.refine = nn.Sequential(*refine)

    def forward(self, photo: Tensor) -> Tensor:
        """Photo [batch, 3, y, x], full scale 1, any size, to the sharp image of the same shape in [0, 1].

        In use a photo is continued beyond its border (see `borders`); in training black lies there."""
        sharp = self._sharp(photo) if self.training else self.unclamped(photo)
        return sharp.clamp(0, 1)

    def unclamped(self, photo: Tensor) -> Tensor:
        """As in use, without the clamp."""
        rows, columns = photo.shape[-2:]
        sharp = self._sharp(continued(photo, RADIUS))
        return sharp[..., RADIUS : RADIUS + rows, RADIUS : RADIUS + columns]

    def _sharp(self, photo: Tensor) -> Tensor:
        residual = self.residual if self.training else self._folded()
        # the sum is kept in the photo's own precision: its grey levels are finer than bfloat16's
        sharp = photo + residual(photo).to(photo.dtype)
        with torch.autocast(photo.device.type, enabled=False):
            return self.refine(sharp)

    def _folded(self) -> nn.Module:
        """`residual` with each normalisation folded into the convolution before it, as its statistics are
        fixed in use: fewer passes over memory, the same image but for rounding."""
        layers: list[nn.Module] = []
        for layer in self.residual:
            if isinstance(layer, nn.BatchNorm2d):
                convolution = layers.pop()
                assert isinstance(convolution, nn.Conv2d)
                layer = fuse_conv_bn_eval(convolution, layer)
            layers.append(layer)
        folded: nn.Module = nn.Sequential(*layers)
        return folded.to(memory_format=torch.channels_last)  # pyrefly: ignore[no-matching-overload]
