"""Rings of constant phase, and the same as radii and phases that learn."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Literal

import torch
from pydantic import Field, model_validator
from torch import Tensor, nn

from ...recipe.base import RecipeModel
from ..grid import PupilGrid, disc_amplitude, disc_coverage
from .base import Finite, PhaseMask


class Ring(RecipeModel):
    """A ring of constant phase between two radii (fractions of the pupil's radius)."""

    inner_radius: Annotated[float, Field(ge=0, lt=1)]
    """inner radius, as a fraction of the pupil's"""
    outer_radius: Annotated[float, Field(gt=0, le=1)]
    """outer radius, as a fraction of the pupil's"""
    phase_rad: Finite
    """phase of the ring, rad"""

    @model_validator(mode="after")
    def _has_width(self) -> Ring:
        if self.outer_radius <= self.inner_radius:
            raise ValueError("outer_radius must be above inner_radius")
        return self


class RingsMask(PhaseMask):
    """Concentric rings of constant phase; between and around them the phase is 0.

    S. Elmalem, R. Giryes, E. Marom, "Learned phase coded aperture for the benefit of depth of field
    extension", Opt. Express 26, 15316 (2018): one ring or several, learned together with a network.
    """

    kind: Literal["rings"] = "rings"
    rings: Annotated[tuple[Ring, ...], Field(min_length=1, max_length=64)] = (
        Ring(inner_radius=0.55, outer_radius=0.8, phase_rad=6.2),
        Ring(inner_radius=0.8, outer_radius=1.0, phase_rad=12.3),
    )
    """rings of constant phase"""

    @model_validator(mode="after")
    def _apart(self) -> RingsMask:
        ordered = sorted(self.rings, key=lambda ring: ring.inner_radius)
        for inner, outer in zip(ordered, ordered[1:], strict=False):
            if outer.inner_radius < inner.outer_radius:
                raise ValueError(
                    f"rings overlap: one ends at {inner.outer_radius:g}, the next begins at"
                    f" {outer.inner_radius:g}"
                )
        return self

    def phase(self, grid: PupilGrid) -> Tensor:
        flat = torch.zeros(grid.samples, grid.samples, dtype=torch.float64)
        return sum((ring.phase_rad * _cells(ring, grid, disc_coverage) for ring in self.rings), flat)

    def regions(self, grid: PupilGrid) -> list[tuple[Tensor, float]]:
        rings = [(_cells(ring, grid, disc_amplitude), ring.phase_rad) for ring in self.rings]
        bare = disc_amplitude(grid, grid.radius) - sum(amplitude for amplitude, _ in rings)
        return [(bare, 0.0), *rings]

    def learner(self, grid: PupilGrid, radian: float) -> nn.Module:
        rho = grid.radius_squared().sqrt() / grid.radius
        radii = torch.tensor([(ring.inner_radius, ring.outer_radius) for ring in self.rings])
        phases = torch.tensor([ring.phase_rad for ring in self.rings])
        return RingHeight(radii, phases, rho, radian, grid.pitch / grid.radius)


def _cells(ring: Ring, grid: PupilGrid, disc: Callable[[PupilGrid, float], Tensor]) -> Tensor:
    """A ring's share of each cell, by what `disc` makes of its two edges."""
    outer = disc(grid, ring.outer_radius * grid.radius)
    return outer - disc(grid, ring.inner_radius * grid.radius) if ring.inner_radius else outer


class RingHeight(nn.Module):
    """Concentric rings whose radii and phases learn (Elmalem et al., 2018).

    radii: [ring, 2], inner and outer as fractions of the pupil's radius.
    phases: [ring] in radians at the design wavelength.
    rho: [n, n], distance from the axis in pupil radii.
    radian: metres of height that delay by one radian.
    edge: width of a ring's edge in pupil radii, one sample of the mask: samples that an edge crosses have
        their share of the ring's height, and through them its radius learns.
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
