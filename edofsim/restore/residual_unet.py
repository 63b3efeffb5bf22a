"""A U-Net of residual blocks of whole 3x3 convolutions (after DRUNet: Zhang et al., TPAMI 44, 2022).

Against the depthwise convolutions of `local_unet` it has ten times as many weights and multiplications; where
a processor multiplies matrices of bfloat16 (AMX) or on a GPU these cost little. It has no normalisation, so
that it is local: a photo restored in tiles is the same as whole.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

from .local_unet import padded_to


class ResidualTrunk(nn.Module):
    """On 2x2-unshuffled pixels, [batch, inputs, y, x] to [batch, outputs, y, x]; untrained, it returns zeros.

    channels: of each level, each at half the resolution of the one before; blocks: blocks a level, on the
    way down and (except for the last level) on the way up; side: channels of coarse maps that it is given
    besides. multiple, radius: see `local_unet.Trunk`.
    """

    def __init__(
        self, inputs: int, outputs: int, channels: tuple[int, ...], blocks: tuple[int, ...], side: int = 0
    ) -> None:
        super().__init__()
        self.channels, self.blocks = tuple(channels), tuple(blocks)
        levels = len(self.channels)
        if levels == 0 or len(self.blocks) != levels:
            raise ValueError(f"channels {channels} and blocks {blocks}: one number each a level")
        self.first = nn.Conv2d(4 * inputs + side, channels[0], 3, padding=1)
        self.last = nn.Conv2d(channels[0], 4 * outputs, 3, padding=1)
        self.down_blocks, self.up_blocks = (
            nn.ModuleList(
                nn.Sequential(*(ResidualBlock(channels[level]) for _ in range(blocks[level])))
                for level in range(count)
            )
            for count in (levels, levels - 1)
        )
        pairs = list(zip(channels, channels[1:], strict=False))
        self.downs = nn.ModuleList(nn.Conv2d(fine, coarse, 2, 2) for fine, coarse in pairs)
        self.ups = nn.ModuleList(nn.Conv2d(coarse, 4 * fine, 1) for fine, coarse in pairs)
        nn.init.zeros_(self.last.weight)
        assert self.last.bias is not None
        nn.init.zeros_(self.last.bias)
        self.multiple = 1 << levels
        self.radius = 2 + 2 + self.multiple
        for level, count in enumerate(self.blocks):
            passes = count if level == levels - 1 else 2 * count
            self.radius += 2 * passes * (2 << level)

    def settings(self) -> dict[str, list[int]]:
        """What rebuilds it, but for its inputs and outputs."""
        return {"channels": list(self.channels), "blocks": list(self.blocks)}

    def forward(self, images: Tensor, side: Tensor | None = None) -> Tensor:
        """images: [batch, inputs, y, x]; side: [batch, side, y, x]."""
        rows, columns = images.shape[-2:]
        fine = functional.pixel_unshuffle(padded_to(images, self.multiple), 2)
        if side is not None:
            fine = torch.cat([fine, functional.avg_pool2d(padded_to(side, self.multiple), 2)], 1)
        features = self.first(fine)
        skipped = []
        for level, blocks in enumerate(self.down_blocks):
            features = blocks(features)
            if level < len(self.downs):
                skipped.append(features)
                features = self.downs[level](features)
        for level in reversed(range(len(self.ups))):
            features = skipped[level] + functional.pixel_shuffle(self.ups[level](features), 2)
            features = self.up_blocks[level](features)
        return functional.pixel_shuffle(self.last(features), 2)[..., :rows, :columns]


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
