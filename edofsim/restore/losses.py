"""The training loss of Akpinar et al.: L1 and the sparse gradient prior that spares the true edges.

The paper leaves alpha, beta and gamma open. Chosen here:

gamma = 0.8, the exponent of the sparse prior that the paper takes from Levin et al. (2007).
beta = 10: an edge of a tenth of full scale keeps exp(-10 * 0.1^0.8) = 0.2 of the prior's weight, a step of
    one part in 255 keeps 0.89, so that noise in flat places is smoothed and edges are not.
alpha = 0.01: at a step of one part in 255 the prior pulls a pixel with about 2 % of L1's force per
    difference, enough to settle ringing in flat places and too little to cost PSNR.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

ROUNDING = 1e-3


@dataclass(frozen=True)
class LossWeights:
    """alpha, beta, gamma of Eq. `Loss` and Eq. `Regularization`."""

    alpha: float = 0.01
    beta: float = 10.0
    gamma: float = 0.8


def restoration_loss(restored: Tensor, sharp: Tensor, weights: LossWeights = LossWeights()) -> Tensor:
    """Eq. `Loss`: L1 (Eq. `L1`) plus alpha times `gradient_prior`.

    restored, sharp: [batch, band, y, x]. Both terms are divided by the number of values, so that the loss
        does not depend on the size of the patch.

    Returns a scalar.
    """
    return (restored - sharp).abs().mean() + weights.alpha * gradient_prior(restored, sharp, weights)


def gradient_prior(restored: Tensor, sharp: Tensor, weights: LossWeights = LossWeights()) -> Tensor:
    """Eq. `Regularization`: |difference|^gamma of `restored`, weighted down at the edges of `sharp`.

    restored, sharp: [batch, 3, y, x].

    With gamma < 1 the slope of |g|^gamma is infinite at g = 0, where most of an image is. The power is
    taken of sqrt(g^2 + e^2), less its value at 0, with e = 0.001, a quarter of an 8-bit step: the slope is
    then 0 at 0 and the value is still 0 for a flat image.
    """
    total = restored.new_zeros(())
    for axis in (-2, -1):
        edges = torch.exp(-weights.beta * sharp.diff(dim=axis).abs() ** weights.gamma)
        total = total + (edges * _power(restored.diff(dim=axis), weights.gamma)).sum()
    return total / restored.numel()


def _power(gradient: Tensor, gamma: float) -> Tensor:
    return (gradient.square() + ROUNDING**2) ** (gamma / 2) - ROUNDING**gamma
