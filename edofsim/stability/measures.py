"""How far an image is from its truth: locally, in what the sensor would notice."""

from __future__ import annotations

import torch
from torch import Tensor

READ_NOISE = 0.005
"""Of full scale: the noise of the paper's sensor."""
MIDDLE_GREY = 0.18
"""Of full scale: where an exposure puts the median of a photo."""
NAN = float("nan")


def floor_of(truth: Tensor) -> float:
    """The sensor's noise in an image exposed for its median, not for the lamps in it: smaller values are
    reported from each other by no sensor.

    truth: [channel, y, x].
    """
    return float(truth.abs().median()) * READ_NOISE / MIDDLE_GREY


def _local(image: Tensor, truth: Tensor) -> Tensor:
    """Differences relative to the value itself, or to `floor_of` the truth where that is more."""
    scale = truth.abs().clamp_min(max(floor_of(truth), torch.finfo(torch.float64).tiny))
    return (image.double() - truth).abs() / scale


def _finite(*images: Tensor) -> bool:
    return all(bool(torch.isfinite(image).all()) for image in images)


def worst(image: Tensor, truth: Tensor) -> float:
    """The largest difference, relative to the local value; NaN where anything is not finite.

    image: any shape [...].
    truth: the same shape [...].
    """
    return float(_local(image, truth).max()) if _finite(image, truth) else NAN


def typical(image: Tensor, truth: Tensor) -> float:
    """Root mean square of the differences, each relative to the local value; NaN likewise.

    image: any shape [...].
    truth: the same shape [...].
    """
    return float(_local(image, truth).square().mean().sqrt()) if _finite(image, truth) else NAN


def distance(image: Tensor, truth: Tensor) -> float:
    """Largest difference relative to the largest value, for what has no sensor: PSFs, gradients, losses.

    image: any shape [...].
    truth: the same shape [...].
    """
    if not _finite(image, truth):
        return NAN
    scale = float(truth.abs().max())
    return float((image - truth).abs().max()) / scale if scale > 0 else float(image.abs().max())
