"""What comes out of a camera."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from torch import Tensor

PHOTO_MODEL_VERSION = 7
"""Raised when the same view and camera make another photo: what was measured of the old ones is left then."""


@dataclass(frozen=True)
class Photo:
    """A sensor image and what it is judged by. All images are linear, [channel, y, x], full scale 1.

    image: with noise; clean: without; ideal: all in focus, same response and exposure;
    exposure: factor from radiance to full scale; truncated: fraction of the light that left the PSF windows
    and came back as veiling glare (see `photograph.glare_of`), per channel [channel]; how: the choices that
    were made (method, layers, occlusion, ...); seconds: time of each stage.
    """

    image: Tensor
    clean: Tensor
    ideal: Tensor
    exposure: float
    truncated: Tensor
    how: Mapping[str, object] = field(default_factory=dict)
    seconds: Mapping[str, float] = field(default_factory=dict)
