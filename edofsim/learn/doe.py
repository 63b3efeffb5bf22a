"""Masks that learn: from trainable values to the height map of the DOE."""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn


class FreeHeight(nn.Module):
    """A height of its own for each sample of the mask, held between 0 and what can be made.

    What learns is a phase in radians at the design wavelength, as in Akpinar et al.; the height follows
    it with slope one around the middle and levels off towards the limits, so that every step of the
    optimiser changes the mask and none leaves the range.

    start: [n, n] in metres, anywhere in [0, limit]; limit: metres; radian: metres of height that delay the
    design wavelength by one radian.
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


class BasisHeight(nn.Module):
    """A sum of given shapes: Zernike polynomials or harmonics (Sitzmann et al., 2018).

    basis: [term, n, n] in metres for a coefficient of one radian; start: [term] in radians. The sum is
    shifted to start at height 0, which no photo can tell from another start.
    """

    def __init__(self, basis: Tensor, start: Tensor) -> None:
        super().__init__()
        self.register_buffer("basis", basis.to(torch.float32), persistent=False)
        self.phase = nn.Parameter(start.to(torch.float32).clone())

    def forward(self) -> Tensor:
        """The height map, [n, n] in metres."""
        height = torch.einsum("t,tyx->yx", self.phase, self.basis)
        return height - height.detach().amin()


class RingHeight(nn.Module):
    """Concentric rings whose radii and phases learn (Elmalem et al., 2018).

    radii: [ring, 2], inner and outer as fractions of the pupil's radius; phases: [ring] in radians at the
    design wavelength; rho: [n, n], distance from the axis in pupil radii; radian: metres of height that
    delay by one radian; edge: width of a ring's edge in pupil radii, one sample of the mask: samples that an
    edge crosses have their share of the ring's height, and through them its radius learns.
    """

    def __init__(self, radii: Tensor, phases: Tensor, rho: Tensor, radian: float, edge: float) -> None:
        super().__init__()
        self.radian, self.edge = radian, edge
        self.register_buffer("rho", rho.to(torch.float32), persistent=False)
        self.radii = nn.Parameter(radii.to(torch.float32).clone())
        self.phase = nn.Parameter(phases.to(torch.float32).clone())

    def forward(self) -> Tensor:
        """The height map, [n, n] in metres, 0 outside the rings."""
        inner, outer = (self.radii[:, side, None, None] for side in (0, 1))
        inside = self._share(self.rho - inner) * self._share(outer - self.rho)
        height = self.radian * torch.einsum("t,tyx->yx", self.phase, inside)
        return height - height.detach().amin().clamp(max=0)

    def _share(self, distance: Tensor) -> Tensor:
        return (distance / self.edge + 0.5).clamp(0, 1)


class FixedHeight(nn.Module):
    """A mask that does not learn. height: [n, n] in metres."""

    def __init__(self, height: Tensor) -> None:
        super().__init__()
        self.register_buffer("height", height.to(torch.float32), persistent=False)

    def forward(self) -> Tensor:
        return self.height


class NoHeight(nn.Module):
    """A camera whose mask, if any, has no relief."""

    def forward(self) -> None:
        return None


def metres_per_radian(index: float, wavelength: float) -> float:
    """Height of a material of refractive index `index` that delays `wavelength` [m] by a radian
    (Eq. `dtophi` turned round)."""
    return wavelength / (2 * math.pi * (index - 1))
