"""Masks that learn: from trainable values to the height map of the DOE."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import torch
from torch import Tensor, nn

from ..errors import InputError


class MaskMaps(NamedTuple):
    """What a mask gives, each [n, n] or None: heights in metres, and the amplitude that passes, 0 to 1."""

    height: Tensor | None = None
    amplitude: Tensor | None = None


def maps_of(mask: nn.Module) -> MaskMaps:
    """The maps of a mask that learns or not. Raises InputError for what are none."""
    given = mask()
    if not isinstance(given, Mapping):
        given = {"height": given}
    if set(given) <= set(MaskMaps._fields) and all(isinstance(one, Tensor | None) for one in given.values()):
        return MaskMaps(**given)
    said = ", ".join(f"{name}: {type(one).__name__}" for name, one in given.items())
    raise InputError(
        f"the mask gives {said}: it is to give a height map [n, n] in metres, or a dict of tensors, height "
        "and amplitude"
    )


class FreeHeight(nn.Module):
    """A height of its own for each sample of the mask, held between 0 and what can be made.

    What learns is a phase in radians at the design wavelength, as in Akpinar et al.; the height follows
    it with slope one around the middle and levels off towards the limits, so that every step of the
    optimiser changes the mask and none leaves the range.

    start: [n, n] in metres, anywhere in [0, limit].
    limit: metres.
    radian: metres of height that delay the design wavelength by one radian.
    """

    def __init__(self, start: Tensor, limit: float, radian: float) -> None:
        super().__init__()
        self.limit = limit
        self.reach = limit / radian / 4
        # a map that touches its limits starts just inside them, where the slope is not yet zero
        share = (start.to(torch.float32) / limit).clamp(0.02, 0.98)
        self.phase = nn.Parameter(self.reach * torch.logit(share))

    def forward(self) -> Tensor:
        """The height map, [n, n] in metres."""
        return self.limit * torch.sigmoid(self.phase / self.reach)


class FixedHeight(nn.Module):
    """A mask that does not learn.

    height: [n, n] in metres; None for a mask without one.
    amplitude: [n, n] from 0 to 1; None for a mask that lets all light through.
    """

    height: Tensor | None
    amplitude: Tensor | None

    def __init__(self, height: Tensor | None, amplitude: Tensor | None = None) -> None:
        super().__init__()
        for name, given in (("height", height), ("amplitude", amplitude)):
            values = None if given is None else given.to(torch.float32)
            self.register_buffer(name, values, persistent=False)

    def forward(self) -> dict[str, Tensor | None]:
        return {"height": self.height, "amplitude": self.amplitude}


class NoHeight(nn.Module):
    """A camera whose mask, if any, has no height map."""

    def forward(self) -> None:
        return None


def metres_per_radian(index: float, wavelength: float) -> float:
    """Height of a material of refractive index `index` that delays `wavelength` [m] by a radian
    (Eq. `dtophi` turned round)."""
    return wavelength / (2 * math.pi * (index - 1))
