"""What rays say of a lens over its field: where they land, and where those next to the chief ray meet.
Lengths in millimetres."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from .aim import Focused
from .pupil import Pupil, chief_of, pupil, reference
from .trace import Rays

ACROSS = 41
"""Rays along each side of the grid whose spot is drawn."""
NEIGHBOUR = 1e-3
"""Of the pupil's radius: how far from the chief ray its neighbours are."""


@dataclass(frozen=True, eq=False)
class Spot:
    """Rays of one wavelength from one point.

    x, y: [ray], where they land on the sensor from where the chief ray of the reference wavelength does,
        upright as a picture: y above it, away from the axis.
    """

    x: Tensor
    y: Tensor

    @property
    def rms(self) -> float:
        """Root mean square of the distance from their middle."""
        return math.sqrt(float(self.x.var(correction=0) + self.y.var(correction=0)))


@torch.no_grad()
def spots(
    held: Focused, tangent: float, wavelengths: Tensor, distance: float, moved: float = 0.0
) -> list[Spot]:
    """Spots at wavelengths [m], [wavelength], of a point `tangent` above the axis.

    wavelengths: [wavelength], metres.
    distance: of the point before the entrance pupil, along the axis, may be infinite.
    moved: how far behind `held.sensor` the sensor is. Rays stand for equal areas of the entrance pupil.

    Raises InputError where no light gets through, or a wavelength is outside the data of a glass.
    """
    seen = pupil(held, torch.tensor([tangent], dtype=torch.float64), distance)
    steps = torch.linspace(-1, 1, ACROSS, dtype=torch.float64)
    y, x = (each.flatten()[None] for each in torch.meshgrid(steps, steps, indexing="ij"))
    y, x = seen.middle + y * seen.half[1], x * seen.half[0]
    chief = _chief(seen, reference(held)).to_plane(moved).y
    found = []
    for index in held.lens.index(wavelengths)[:, None, None]:
        rays, _, shut, _ = seen.through(index, x, y)
        rays = rays.to_plane(moved)
        fine = (shut.amax(0) <= 1) & (rays.lost == 0)
        found.append(Spot(-rays.x[fine], -(rays.y - chief)[fine]))
    return found


@torch.no_grad()
def foci(held: Focused, tangents: Tensor, wavelength: float, distance: float) -> tuple[Tensor, Tensor]:
    """(tangential, sagittal): how far behind `held.sensor`, along the axis, rays next to the chief ray meet
    it, in the plane of the field and across it, [field], at a wavelength [m].

    tangents: [field].
    """
    seen = chief_of(held, tangents, distance)
    index = held.lens.index(torch.tensor([wavelength], dtype=torch.float64))[:, None]
    step, count = NEIGHBOUR * held.entrance_radius, len(tangents)
    x, y = torch.tensor([[0.0, 0.0, 0.0, step], [0.0, step, -step, 0.0]], dtype=torch.float64)
    rays = seen.through(index, x.expand(count, 4), y.expand(count, 4))[0]
    up, right = rays.up / rays.along, rays.right / rays.along
    return (
        -(rays.y[:, 1] - rays.y[:, 2]) / (up[:, 1] - up[:, 2]),
        -(rays.x[:, 3] - rays.x[:, 0]) / (right[:, 3] - right[:, 0]),
    )


@torch.no_grad()
def heights(
    held: Focused, tangents: Tensor, wavelengths: Tensor, distance: float, moved: float = 0.0
) -> Tensor:
    """How far from the axis rays land that go through the stop's centre at the reference wavelength,
    [field, wavelength]: their differences are lateral colour.

    tangents: [field].
    wavelengths: [wavelength], metres.
    """
    seen = chief_of(held, tangents, distance)
    indices = held.lens.index(wavelengths)[:, None, None]
    return torch.cat([-_chief(seen, index).to_plane(moved).y for index in indices], -1)


def _chief(seen: Pupil, index: Tensor) -> Rays:
    zero = torch.zeros_like(seen.plane)
    return seen.through(index, zero, zero)[0]
