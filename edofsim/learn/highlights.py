"""Saturated highlights in patches: lamps and reflections many times brighter than full scale.

No 8-bit photograph holds them, and a network that never saw one takes the rings that a linear filter leaves
around them for things in the scene.
"""

from __future__ import annotations

import torch
from torch import Tensor

COUNT = (1, 4)  # highlights in a patch, least and most
RADIUS_PX = (0.3, 3.0)
LENGTH_PX = (0.0, 12.0)  # of the line whose surroundings a highlight fills: 0 is a disc
BRIGHTNESS = (1.2, 60.0)  # times full scale, uniform in its logarithm
TINT = (0.3, 1.0)  # of each colour
DIMMED = (0.03, 1.0)  # what is left of the rest, uniform in its logarithm: highlights stand out in the dark


def with_highlights(sharp: Tensor, share: float, generator: torch.Generator) -> Tensor:
    """A share of the patches [batch, 3, y, x] dimmed and with a few highlights; the others as they are.

    sharp: [batch, 3, y, x].
    """
    found = []
    for patch in sharp:
        lit = float(torch.rand((), generator=generator)) < share
        found.append(_lit(patch, generator) if lit else patch)
    return torch.stack(found)


def _lit(patch: Tensor, generator: torch.Generator) -> Tensor:
    rows, columns = patch.shape[-2:]
    row = torch.arange(rows, dtype=patch.dtype)[:, None]
    column = torch.arange(columns, dtype=patch.dtype)
    image = patch * _uniform(DIMMED, generator, logarithm=True)
    for _ in range(int(torch.randint(COUNT[0], COUNT[1] + 1, (), generator=generator))):
        middle = torch.rand(2, generator=generator) * torch.tensor([rows, columns])
        angle = _uniform((0.0, torch.pi), generator)
        half = _uniform(LENGTH_PX, generator) / 2
        radius = _uniform(RADIUS_PX, generator)
        down, across = row - middle[0], column - middle[1]
        # to the nearest point of the line
        along = (down * angle.sin() + across * angle.cos()).clamp(-half, half)
        distance = (down - along * angle.sin()).hypot(across - along * angle.cos())
        cover = (radius + 0.5 - distance).clamp(0, 1)
        colour = _uniform(BRIGHTNESS, generator, logarithm=True) * torch.stack(
            [_uniform(TINT, generator) for _ in range(3)]
        )
        image = image * (1 - cover) + cover * colour[:, None, None]
    return image


def _uniform(bounds: tuple[float, float], generator: torch.Generator, *, logarithm: bool = False) -> Tensor:
    low, high = torch.tensor(bounds, dtype=torch.float32)
    share = torch.rand((), generator=generator)
    return low * (high / low) ** share if logarithm else low + (high - low) * share
