"""Patches in other light: darker and brighter, of other colours, grey.

Photographs are exposed and balanced to look well. What a camera sees is not, and a network that saw nothing
else takes its level and its colours from them.
"""

from __future__ import annotations

import torch
from torch import Tensor

from ..recipe.base import NotNegative, Positive, RecipeModel
from ..recipe.train import Range


class Variation(RecipeModel):
    """How photographs are changed before they are photographed, each patch in its own way; as they are unless
    given. What is beyond full scale is clipped in the truth, and in the photo where the source has saturated
    highlights and clips them."""

    exposure: tuple[Positive, Positive] = (1.0, 1.0)
    """range of factors on the light, drawn evenly in their logarithm"""
    white_balance: NotNegative = 0.0
    """each colour's factor is drawn between exp(-w) and exp(w)"""
    colourfulness: Range = (1.0, 1.0)
    """range of factors on how far colours are from grey: 0 is grey, 2 gaudy"""

    @property
    def changes(self) -> bool:
        """Whether anything is changed at all."""
        return self != Variation()


def varied(
    sharp: Tensor, means: Tensor, variation: Variation, generator: torch.Generator
) -> tuple[Tensor, Tensor]:
    """Patches [batch, 3, y, x] and the means [batch, 3] of the pictures that they are from, changed alike.

    sharp: [batch, 3, y, x].
    means: [batch, 3].
    """
    draws = torch.rand(len(sharp), 5, generator=generator)
    return _changed(sharp, means, variation, draws)


def evenly(sharp: Tensor, means: Tensor, variation: Variation) -> tuple[Tensor, Tensor]:
    """The same with exposures spread evenly over the batch in their logarithm, and colours as they are.

    sharp: [batch, 3, y, x].
    means: [batch, 3].
    """
    draws = torch.full((len(sharp), 5), 0.5)
    draws[:, 0] = (torch.arange(len(sharp)) + 0.5) / len(sharp)
    only = Variation(exposure=variation.exposure)
    return _changed(sharp, means, only, draws)


def _changed(sharp: Tensor, means: Tensor, variation: Variation, draws: Tensor) -> tuple[Tensor, Tensor]:
    """draws: [batch, 5] from 0 to 1, of exposure, three colours, and colourfulness."""
    low, high = variation.exposure
    exposure = low * (high / low) ** draws[:, :1]
    balance = (variation.white_balance * (2 * draws[:, 1:4] - 1)).exp()
    dull, gaudy = variation.colourfulness
    colourfulness = dull + (gaudy - dull) * draws[:, 4:]

    def changed(colours: Tensor, factors: Tensor, strength: Tensor) -> Tensor:
        grey = colours.mean(1, keepdim=True)
        return (factors * (grey + strength * (colours - grey))).clamp_min(0)

    factors = exposure * balance
    pixels = changed(sharp, factors[..., None, None], colourfulness[..., None, None])
    return pixels, changed(means, factors, colourfulness)
