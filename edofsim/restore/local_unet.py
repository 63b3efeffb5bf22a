"""A stronger deblurring network: a small U-Net of NAFNet's blocks, made local.

NAFNet (Chen et al., "Simple Baselines for Image Restoration", ECCV 2022) needs no activation function:
two halves of the channels are multiplied instead. Its global channel attention is left out: a mean over
the whole image makes the result depend on the size of the patch, and trained on small patches it costs
sharpness on large photos. What remains is local, so that a photo restored in tiles is the same as whole.
"""

from __future__ import annotations

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
        where a clamp would stop the gradient of the pixels that need it most.

        photo: [batch, 3, y, x], full scale 1.
        """
        sharp = self.unclamped(photo)
        return sharp if self.training else sharp.clamp(0, 1)

    def unclamped(self, photo: Tensor) -> Tensor:
        """The same without the clamp.

        photo: [batch, 3, y, x], full scale 1.
        """
        return photo + self.trunk(photo).to(photo.dtype)


class Trunk(nn.Module):
    """The U-Net itself, [batch, inputs, y, x] to [batch, outputs, y, x]; untrained, it returns zeros.

    side: channels of coarse maps that it is given as well.
    width, blocks, kernel: see `LocalUNet`. multiple: images are padded to a multiple of this many pixels.
        radius: how far in pixels an output pixel sees, at most.
    """

    def __init__(
        self, inputs: int, outputs: int, width: int, blocks: tuple[int, ...], kernel: int, side: int = 0
    ) -> None:
        super().__init__()
        self.width, self.blocks, self.kernel = width, tuple(blocks), kernel
        self.inputs = inputs
        levels = len(self.blocks)
        channels = [width << level for level in range(levels)]
        kernels = [3] + [kernel] * (levels - 1)
        self.first = nn.Conv2d(4 * inputs + side, width, 3, padding=1)
        self.last = nn.Conv2d(width, 4 * outputs, 3, padding=1)
        self.down_blocks = nn.ModuleList(
            nn.Sequential(*(GatedBlock(channels[i], kernels[i]) for _ in range(self.blocks[i])))
            for i in range(levels)
        )
        self.up_blocks = nn.ModuleList(
            nn.Sequential(*(GatedBlock(channels[i], kernels[i]) for _ in range(self.blocks[i])))
            for i in range(levels - 1)
        )
        self.downs = nn.ModuleList(nn.Conv2d(channels[i], channels[i + 1], 2, 2) for i in range(levels - 1))
        self.ups = nn.ModuleList(nn.Conv2d(channels[i + 1], 4 * channels[i], 1) for i in range(levels - 1))
        nn.init.zeros_(self.last.weight)
        assert self.last.bias is not None
        nn.init.zeros_(self.last.bias)
        self.multiple = 1 << levels
        self.radius = self._radius()

    def _radius(self) -> int:
        reach = 2 + 2 + self.multiple  # first and last convolution, and pixels that share a coarse one
        for level, count in enumerate(self.blocks):
            passes = count if level == len(self.blocks) - 1 else 2 * count
            reach += passes * ((3 if level == 0 else self.kernel) // 2) * (2 << level)
        return reach

    def settings(self) -> dict[str, int | list[int]]:
        """What rebuilds it, but for its inputs and outputs."""
        return {"width": self.width, "blocks": list(self.blocks), "kernel": self.kernel}

    def grown(self, other: Trunk) -> dict[str, Tensor]:
        """Weights that make it give what another one does, of the images, maps and outputs that both have,
        the first ones; what the other does not have is zero, and blocks of its own hand on what they get."""
        weights, found = other.state_dict(), self.state_dict()
        first, images = weights["first.weight"], 4 * min(self.inputs, other.inputs)
        wider = torch.zeros_like(self.first.weight)
        wider[:, :images] = first[:, :images]
        maps, theirs = 4 * self.inputs, 4 * other.inputs
        wider[:, maps : maps + first.shape[1] - theirs] = first[:, theirs:]
        for name in ("last.weight", "last.bias"):
            both = torch.zeros_like(found[name])
            count = min(len(both), len(weights[name]))
            both[:count] = weights[name][:count]
            weights[name] = both
        return {**found, **weights, "first.weight": wider}

    def forward(self, images: Tensor, side: Tensor | None = None) -> Tensor:
        """images: [batch, inputs, y, x].
        side: [batch, side, y, x].
        """
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
