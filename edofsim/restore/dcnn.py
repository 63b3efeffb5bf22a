"""The deblurring network of Akpinar et al. (their Sec. "Deblurring CNN")."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional
from torch.nn.utils.fusion import fuse_conv_bn_weights

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
        beyond = continued(photo, RADIUS)
        if not self.training:
            return self._in_use(beyond.contiguous(memory_format=torch.channels_last))
        rows, columns = photo.shape[-2:]
        return self._sharp(beyond)[..., RADIUS : RADIUS + rows, RADIUS : RADIUS + columns]

    def _sharp(self, photo: Tensor) -> Tensor:
        # the sum is kept in the photo's own precision: its grey levels are finer than bfloat16's
        sharp = photo + self.residual(photo).to(photo.dtype)
        with torch.autocast(photo.device.type, enabled=False):
            return self.refine(sharp)

    def _in_use(self, beyond: Tensor) -> Tensor:
        """The same of a photo that goes on for `RADIUS` pixels, which become its border and are left out
        layer by layer. Each normalisation, whose statistics are fixed in use, is folded into the convolution
        before it: fewer passes over memory, the same image but for rounding."""
        *blocks, last = self.residual
        assert isinstance(last, nn.Conv2d)
        seen = beyond
        for convolution, normalisation in zip(blocks[::3], blocks[1::3], strict=True):
            assert isinstance(convolution, nn.Conv2d) and isinstance(normalisation, nn.BatchNorm2d)
            mean, variance = normalisation.running_mean, normalisation.running_var
            assert mean is not None and variance is not None
            known = mean, variance, normalisation.eps, normalisation.weight, normalisation.bias
            folded = fuse_conv_bn_weights(convolution.weight, convolution.bias, *known)
            seen = functional.conv2d(seen, *folded, dilation=convolution.dilation)
            seen = functional.leaky_relu_(seen, LEAK)
        residual = functional.conv2d(seen, last.weight, last.bias)
        left = sum(DILATIONS) + 1
        sharp = beyond[..., left:-left, left:-left] + residual.to(beyond.dtype)
        with torch.autocast(beyond.device.type, enabled=False):
            for layer in self.refine:
                assert isinstance(layer, nn.ConvTranspose2d)
                sharp = functional.conv_transpose2d(sharp, layer.weight, layer.bias, padding=2)
        return sharp
