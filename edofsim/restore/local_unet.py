"""A stronger deblurring network: a small U-Net of NAFNet's blocks, made local.

NAFNet (Chen et al., "Simple Baselines for Image Restoration", ECCV 2022) needs no activation function:
two halves of the channels are multiplied instead. Its global channel attention is left out: a mean over
the whole image makes the result depend on the size of the patch, and trained on small patches it costs
sharpness on large photos. What remains is local, so that a photo restored in tiles is the same as whole.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import torch
from torch import Tensor, nn
from torch.nn import functional

from .restorer import Restorer


class LocalUNet(Restorer):
    """U-Net on 2x2-unshuffled pixels; adds its output to the photo. 446,000 weights by default.

    width: channels of the first level; each further level has twice as many at half the resolution.
    blocks: blocks a level, on the way down and (except for the last level) on the way up.
    kernel: size of the depthwise convolutions of the second and later levels (the first has 3).
    """

    kind = "local-unet"

    def __init__(self, width: int = 32, blocks: tuple[int, ...] = (2, 2, 2), kernel: int = 5) -> None:
        super().__init__()
        self.trunk = Trunk(3, 3, width, blocks, kernel)
        self.radius, self.multiple = self.trunk.radius, self.trunk.multiple

    def settings(self) -> dict[str, object]:
        return {**self.trunk.settings()}

    def forward(self, photo: Tensor) -> Tensor:
        """Photo [batch, 3, y, x], full scale 1, to the sharp image. Clamped to [0, 1] except in training,
        where a clamp would stop the gradient of the pixels that need it most."""
        sharp = self.unclamped(photo)
        return sharp if self.training else sharp.clamp(0, 1)

    def unclamped(self, photo: Tensor) -> Tensor:
        """The same without the clamp."""
        return photo + self.trunk(photo).to(photo.dtype)


class UNet(nn.Module):
    """On 2x2-unshuffled pixels, [batch, inputs, y, x] to [batch, outputs, y, x]; untrained, it returns zeros.

    channels: of each level, each at half the resolution of the one before; blocks: blocks a level, on the
    way down and (except for the last level) on the way up; block: makes one of a level; reaches: how far a
    block of each level sees, in its pixels; side: channels of coarse maps that it is given besides.
    multiple: images are padded to a multiple of so many pixels. radius: how far in pixels an output pixel
    sees, at most.
    """

    def __init__(
        self,
        inputs: int,
        outputs: int,
        channels: Sequence[int],
        blocks: Sequence[int],
        block: Callable[[int], nn.Module],
        reaches: Sequence[int],
        side: int = 0,
    ) -> None:
        super().__init__()
        self.blocks = tuple(blocks)
        levels = len(self.blocks)
        if levels == 0 or len(channels) != levels:
            raise ValueError(f"channels {list(channels)} and blocks {list(blocks)}: one number each a level")
        self.first = nn.Conv2d(4 * inputs + side, channels[0], 3, padding=1)
        self.last = nn.Conv2d(channels[0], 4 * outputs, 3, padding=1)
        self.down_blocks, self.up_blocks = (
            nn.ModuleList(
                nn.Sequential(*(block(level) for _ in range(self.blocks[level]))) for level in range(count)
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
        self.radius = 2 + 2 + self.multiple  # first and last convolution, and pixels that share a coarse one
        for level, count in enumerate(self.blocks):
            passes = count if level == levels - 1 else 2 * count
            self.radius += passes * reaches[level] * (2 << level)

    def forward(self, images: Tensor, side: Tensor | None = None) -> Tensor:
        """images: [batch, inputs, y, x]; side: [batch, side, y, x]."""
        rows, columns = images.shape[-2:]
        fine = functional.pixel_unshuffle(self._padded(images), 2)
        if side is not None:
            fine = torch.cat([fine, functional.avg_pool2d(self._padded(side), 2)], 1)
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

    def _padded(self, images: Tensor) -> Tensor:
        rows, columns = images.shape[-2:]
        padding = (0, -columns % self.multiple, 0, -rows % self.multiple)
        return functional.pad(images, padding, mode="replicate") if any(padding) else images


class Trunk(UNet):
    """One of NAFNet's blocks; width, blocks, kernel: see `LocalUNet`, side: see `UNet`."""

    def __init__(
        self, inputs: int, outputs: int, width: int, blocks: tuple[int, ...], kernel: int, side: int = 0
    ) -> None:
        self.width, self.kernel = width, kernel
        channels = [width << level for level in range(len(blocks))]
        kernels = [3] + [kernel] * (len(blocks) - 1)

        def block(level: int) -> nn.Module:
            return GatedBlock(channels[level], kernels[level])

        super().__init__(inputs, outputs, channels, blocks, block, [size // 2 for size in kernels], side)

    def settings(self) -> dict[str, int | list[int]]:
        """What rebuilds it, but for its inputs and outputs."""
        return {"width": self.width, "blocks": list(self.blocks), "kernel": self.kernel}


class GatedBlock(nn.Module):
    """NAFNet's block without its channel attention: [batch, channel, y, x] to the same shape."""

    def __init__(self, channels: int, kernel: int) -> None:
        super().__init__()
        self.norm_space = ChannelNorm(channels)
        self.widen = nn.Conv2d(channels, 2 * channels, 1)
        self.spread = nn.Conv2d(2 * channels, 2 * channels, kernel, padding=kernel // 2, groups=2 * channels)
        self.narrow = nn.Conv2d(channels, channels, 1)
        self.norm_channels = ChannelNorm(channels)
        self.mix_in = nn.Conv2d(channels, 2 * channels, 1)
        self.mix_out = nn.Conv2d(channels, channels, 1)
        # each branch starts at zero, so that a deep stack starts as the identity
        self.scale_space = nn.Parameter(torch.zeros(1, channels, 1, 1))
        self.scale_channels = nn.Parameter(torch.zeros(1, channels, 1, 1))

    def forward(self, features: Tensor) -> Tensor:
        branch = self.narrow(_gate(self.spread(self.widen(self.norm_space(features)))))
        features = features + branch * self.scale_space
        branch = self.mix_out(_gate(self.mix_in(self.norm_channels(features))))
        return features + branch * self.scale_channels


class ChannelNorm(nn.Module):
    """Layer normalisation over the channels of each pixel."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.weight = nn.Parameter(torch.ones(channels))
        self.bias = nn.Parameter(torch.zeros(channels))

    def forward(self, features: Tensor) -> Tensor:
        last = features.permute(0, 2, 3, 1)
        return functional.layer_norm(last, last.shape[-1:], self.weight, self.bias, 1e-6).permute(0, 3, 1, 2)


def _gate(features: Tensor) -> Tensor:
    first, second = features.chunk(2, dim=1)
    return first * second
