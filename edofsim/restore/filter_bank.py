"""A network that is told the optics: linear filters for parts of the depth range, a choice, and a U-Net.

For one distance the best linear restoration follows from the PSFs in closed form. A bank of such filters,
each for a part of the depth range, gives as many restorations of a photo; at each place one is nearly right.
Which one shows in how strong their details are: where the distance is another, they ring or stay blurred. A
small network weighs them by that, and a U-Net of NAFNet's blocks mends what a linear filter leaves. Filters
before a network: Yanny et al., Optica 9, 96, 2022 (MultiWienerNet), there for places with PSFs of their own.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

from .local_unet import Trunk

CELL = 8  # pixels between the places where a choice is made
REACH = 12  # pixels on each side whose details it rests on
HIDDEN = 64
FLOOR = 1e-6  # of the strength of details: a quarter of an 8-bit step


class FilterBank(nn.Module):
    """Weighs `groups` linear restorations of the photo, and adds what they lack.

    support: width of the filters in pixels, odd; width, blocks, kernel: of the U-Net, see `LocalUNet`.
    filters: [groups * 3 out, 3 in, support, support], not trained; untouched ones return the photo.
    """

    kind = "filter-bank"

    def __init__(
        self,
        groups: int = 8,
        support: int = 33,
        width: int = 24,
        blocks: tuple[int, ...] = (1, 2, 2),
        kernel: int = 5,
    ) -> None:
        super().__init__()
        if groups < 1 or support < 1 or support % 2 == 0:
            raise ValueError(f"{groups} groups, {support} pixels: at least one filter, of an odd width")
        self.groups, self.support = groups, support
        self.choice = nn.Sequential(
            nn.Conv2d(6 * (groups + 1), HIDDEN, 1),
            nn.LeakyReLU(0.1),
            nn.Conv2d(HIDDEN, HIDDEN, 3, padding=1),
            nn.LeakyReLU(0.1),
            nn.Conv2d(HIDDEN, groups, 1),
        )
        self.trunk = Trunk(6, 3, width, blocks, kernel)
        self.multiple = max(self.trunk.multiple, CELL)
        # details, the places around one that decide, and the interpolation between places
        self.radius = self.trunk.radius + support // 2 + 5 + REACH + CELL + 3 * CELL
        filters = torch.zeros(groups, 3, 3, support, support)
        filters[:, range(3), range(3), support // 2, support // 2] = 1
        # channels last asks for four axes
        self.register_buffer("filters", filters.flatten(0, 1))

    def settings(self) -> dict[str, int | list[int]]:
        """What rebuilds this network."""
        return {"groups": self.groups, "support": self.support} | self.trunk.settings()

    def forward(self, photo: Tensor) -> Tensor:
        """Photo [batch, 3, y, x], full scale 1, to the sharp image. Clamped to [0, 1] except in training."""
        with torch.autocast(photo.device.type, enabled=False):
            restorations = self.filtered(photo)
            chosen = self.chosen(photo, restorations)
        seen = torch.cat([photo, chosen], 1).contiguous(memory_format=torch.channels_last)
        sharp = chosen + self.trunk(seen).to(photo.dtype)
        return sharp if self.training else sharp.clamp(0, 1)

    def filtered(self, photo: Tensor) -> Tensor:
        """The photo through every filter, [batch, group, 3, y, x]; its border pixels continue it."""
        reach, (rows, columns) = self.support // 2, photo.shape[-2:]
        padded = functional.pad(photo, (reach,) * 4, mode="replicate")
        size = tuple(-(-n // 16) * 16 for n in padded.shape[-2:])  # quick to transform
        # a convolution of torch does not turn its kernel round: neither does the conjugate
        transfer = torch.fft.rfft2(self.filters, s=size).conj().unflatten(0, (self.groups, 3))
        spectrum = torch.einsum("byxc,gocyx->bgoyx", torch.fft.rfft2(padded, s=size).movedim(1, -1), transfer)
        return torch.fft.irfft2(spectrum, s=size)[..., :rows, :columns]

    def chosen(self, photo: Tensor, restorations: Tensor) -> Tensor:
        """What the choice makes of the restorations [batch, group, 3, y, x] of a photo, [batch, 3, y, x]."""
        return (restorations * self.weights(photo, restorations)[:, :, None]).sum(1)

    def weights(self, photo: Tensor, restorations: Tensor) -> Tensor:
        """How much each restoration counts at each pixel, [batch, group, y, x]; they add up to 1."""
        rows, columns = photo.shape[-2:]
        images = torch.cat([photo, restorations.flatten(1, 2)], 1)
        padding = (0, -columns % CELL, 0, -rows % CELL)
        images = functional.pad(images, padding, mode="replicate") if any(padding) else images
        smooth = _mean(images, 1)
        fine, coarse = images - smooth, smooth - _mean(images, 4)
        strengths = []
        for details in (fine, coarse):
            width = 2 * REACH + CELL
            strength = functional.avg_pool2d(details.square(), width, CELL, REACH, count_include_pad=False)
            strengths.append((strength + FLOOR).log())
        own = [strength[:, :3] for strength in strengths]
        others = [
            strength[:, 3:] - mine.repeat(1, self.groups, 1, 1)
            for strength, mine in zip(strengths, own, strict=True)
        ]
        scores = self.choice(torch.cat([(mine + 8) / 4 for mine in own] + others, 1))
        weights = functional.interpolate(
            scores, scale_factor=CELL, mode="bilinear", align_corners=False
        ).softmax(1)
        return weights[..., :rows, :columns]


def _mean(images: Tensor, reach: int) -> Tensor:
    """Mean over a square of 2 * reach + 1 pixels."""
    return functional.avg_pool2d(images, 2 * reach + 1, 1, reach, count_include_pad=False)
