"""Where rays from a place in the field get through a lens: the part of the entrance pupil that is looked
at."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from ...errors import InputError
from .aim import Focused, chief_planes, launch, on_sphere
from .trace import Hit, Rays, trace, why_lost

LOOK = 17
"""Rays along each side of the grid that the pupil is looked for with; it is half as wide across."""
AIMING_ROUNDS = 3
"""Each with a finer grid where light gets through."""


@dataclass(frozen=True, eq=False)
class Pupil:
    """The entrance pupil seen from places in the field, each [field, 1], float64.

    tangent.

    plane: from the first vertex, where the chief ray crosses the axis.
    vergence: one over the distance of the point from there.
    landing: height [mm] on the sensor of its chief ray at the reference wavelength, below 0 for a place above
        the axis. middle; half (across, along): of an ellipse in the plane that all light that gets through
        lies in.
    """

    held: Focused
    tangent: Tensor
    plane: Tensor
    vergence: Tensor
    landing: Tensor
    middle: Tensor
    half: tuple[Tensor, Tensor]

    @property
    def rims(self) -> tuple[int, ...]:
        """Surfaces other than the stop that shut out light."""
        lens = self.held.lens
        return tuple(n for n, clear in enumerate(lens.clear) if clear is not None and n != lens.stop)

    def through(
        self, index: Tensor, x: Tensor, y: Tensor, hits: list[Hit] | None = None
    ) -> tuple[Rays, Tensor, Tensor, Tensor]:
        """Rays at places [batch, ray] of the plane: on the sensor's plane, with their paths, squares of their
        distances from the axis at stop and rims over the radii [rim, batch, ray], and places in the stop over
        its radius [2, batch, ray]. hits: as of `trace`.

        index: [batch, 1, surface + 1].
        x, y: [batch, ray], mm.
        """
        lens = self.held.lens
        start, direction, longer = launch(self.plane, self.tangent, self.vergence, x, y)
        rays = trace(lens, index, start, direction, (lens.stop, *self.rims), hits=hits)
        rays = rays.to_plane(self.held.sensor)
        stop = torch.stack(rays.at[lens.stop]) / lens.stop_radius
        shut = [stop.square().sum(0)]
        for rim in self.rims:
            clear = lens.clear[rim]
            assert clear is not None
            shut.append((rays.at[rim][0].square() + rays.at[rim][1].square()) / clear**2)
        return rays, rays.path + longer, torch.stack(shut), stop


def chief_of(held: Focused, tangents: Tensor, distance: float | None = None) -> Pupil:
    """The pupil from places of tangents [field], not negative, as wide as seen from the axis; distance [mm]
    of the points before the entrance pupil, along the axis, None for what is in focus.

    tangents: [field], not negative.

    Raises InputError where no chief ray gets through.
    """
    away = held.distance if distance is None else distance
    plane = chief_planes(held, tangents)[:, None]
    vergence = 1 / (away + plane - held.first.entrance)
    zero = torch.zeros_like(plane)
    half = zero + held.entrance_radius
    whole = Pupil(held, tangents[:, None], plane, vergence, zero, zero, (half, half))
    rays = whole.through(reference(held), zero, zero)[0]
    refuse_lost(held, rays.lost[:, 0], tangents)
    return replace(whole, landing=rays.y)


def slant_at_stop(held: Focused, tangents: Tensor) -> Tensor:
    """Sines [field], in air, of the angles with the axis at which chief rays of tangents meet the stop.

    tangents: [field].

    Raises InputError as `chief_of`.
    """
    seen, index = chief_of(held, tangents), reference(held)
    zero = torch.zeros_like(seen.plane)
    start, direction, _ = launch(seen.plane, seen.tangent, seen.vergence, zero, zero)
    number = held.lens.stop + 1
    return trace(held.lens, index, start, direction, surfaces=number).up[:, 0].abs() * index[0, 0, number]


def reference(held: Focused) -> Tensor:
    """Indices at the reference wavelength, [1, 1, surface + 1]."""
    return held.lens.index(torch.tensor([held.wavelength], dtype=torch.float64))[:, None]


def refuse_lost(held: Focused, lost: Tensor, tangents: Tensor) -> None:
    """Raise InputError where a chief ray [field] is lost.

    lost, tangents: [field].
    """
    if bool((lost > 0).any()):
        raise InputError(
            f"rays from {_degrees(tangents[lost > 0][0])} degrees off the axis through the centre of the stop"
            f" {why_lost(held.lens, lost)}"
        )


def _degrees(tangent: Tensor) -> str:
    return f"{math.degrees(math.atan(float(tangent))):.3g}"


@torch.no_grad()
def pupil(held: Focused, tangents: Tensor, distance: float | None = None) -> Pupil:
    """As `chief_of`, and where light gets through.

    tangents: [field], not negative.

    Raises InputError where none does.
    """
    whole, index = chief_of(held, tangents, distance), reference(held)
    side = LOOK // 2
    y, x = torch.meshgrid(
        torch.linspace(-1, 1, LOOK, dtype=torch.float64),
        torch.linspace(0, 1, side + 1, dtype=torch.float64),
        indexing="ij",
    )
    across = along = torch.full((len(tangents), 1), 2 * held.entrance_radius, dtype=torch.float64)
    middle = torch.zeros_like(across)

    def seen() -> tuple[Tensor, Tensor, Rays, Tensor, Tensor]:
        """Places, rays, which are inside, and the least of what shuts them out."""
        at_x, at_y = x.flatten() * across, middle + y.flatten() * along
        rays, _, shut, _ = whole.through(index, at_x, at_y)
        worst = shut.amax(0).where(rays.lost == 0, torch.inf)
        least = worst.amin(-1, keepdim=True)
        # the ray that is nearest to getting through, where none does
        return at_x, at_y, rays, worst < least.clamp_min(1) + 1e-9, least

    for _ in range(AIMING_ROUNDS - 1):
        at_x, at_y, _, inside, _ = seen()
        low = at_y.where(inside, torch.inf).amin(-1, keepdim=True) - along / side
        high = at_y.where(inside, -torch.inf).amax(-1, keepdim=True) + along / side
        across = at_x.where(inside, 0.0).amax(-1, keepdim=True) + across / side
        middle, along = (low + high) / 2, (high - low) / 2
    _, _, rays, inside, least = seen()
    dark = ~(least[:, 0] < 1)
    if bool(dark.any()):
        raise InputError(
            f"no light from {_degrees(tangents[dark][0])} degrees off the axis gets through the lens"
        )
    s, t, _ = on_sphere(held, rays, whole.landing[:, 0])
    s = s.abs().where(inside, 0.0).amax(-1, keepdim=True)
    t = t.where(inside, -torch.inf).amax(-1, keepdim=True) - t.where(inside, torch.inf).amin(-1, keepdim=True)
    size = torch.maximum(s, t / 2)
    half = across * size / s.maximum(size / 8), along * size / (t / 2).maximum(size / 8)
    return replace(whole, middle=middle, half=half)
