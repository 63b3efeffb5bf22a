"""A U-Net of residual blocks of whole 3x3 convolutions (after DRUNet: Zhang et al., TPAMI 44, 2022).

Against the depthwise convolutions of `local_unet` it has ten times as many weights and multiplications; where
a processor multiplies matrices of bfloat16 (AMX) or on a GPU these cost little. It has no normalisation, so
that it is local: a photo restored in tiles is the same as whole.
"""

from __future__ import annotations

from torch import Tensor, nn
from torch.nn import functional

from .local_unet import UNet


class ResidualTrunk(UNet):
    """One of residual blocks; channels, blocks, side: see `UNet`."""

    def __init__(
        self, inputs: int, outputs: int, channels: tuple[int, ...], blocks: tuple[int, ...], side: int = 0
    ) -> None:
        self.channels = tuple(channels)

        def block(level: int) -> nn.Module:
            return ResidualBlock(channels[level])

        super().__init__(inputs, outputs, channels, blocks, block, [2] * len(channels), side)

    def settings(self) -> dict[str, list[int]]:
        """What rebuilds it, but for its inputs and outputs."""
        return {"channels": list(self.channels), "blocks": list(self.blocks)}


class ResidualBlock(nn.Module):
    """Two convolutions whose result is added, [batch, channel, y, x] to the same shape."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.first = nn.Conv2d(channels, channels, 3, padding=1)
        self.second = nn.Conv2d(channels, channels, 3, padding=1)
        # a deep stack starts as the identity
        nn.init.zeros_(self.second.weight)
        assert self.second.bias is not None
        nn.init.zeros_(self.second.bias)

    def forward(self, features: Tensor) -> Tensor:
        return features + self.second(functional.relu(self.first(features)))
