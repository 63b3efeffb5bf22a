"""Rays that a mask in the stop bends. Lengths in millimetres."""

from __future__ import annotations

import math
from dataclasses import replace

import torch
from torch import Tensor

from ..mask_surface import MaskSurface
from .aim import launch, on_sphere
from .outline import delay, in_stop
from .pupil import Pupil
from .surfaces import Stack
from .trace import Rays, trace
from .waves import Wave

MM = 1e-3
SIDE = 19
"""Rays along each side of a square about the pupil."""


@torch.no_grad()
def misplaced(
    seen: Pupil, wave: Wave, wavelength: float, surface: MaskSurface, turn: float, sine: float
) -> float:
    """Root mean square over the pupil, in waves, of the path of rays that the height map bends, where they
    cross the reference sphere, less the path there with what heights add to the ray that is not bent.

    seen, wave: of one place in the field; turn: where that is from the axis; sine: of the angle with the axis
    that all light is taken to pass the height map at.
    """
    held, stop = seen.held, seen.held.lens.stop
    index = held.lens.index(torch.tensor([wavelength], dtype=torch.float64))[:, None]
    side = torch.linspace(-1, 1, SIDE, dtype=torch.float64)
    y, x = (each.reshape(1, -1) for each in torch.meshgrid(side, side, indexing="ij"))
    zero = torch.zeros(1, 1, dtype=torch.float64)
    x, y = torch.cat([zero, x * seen.half[0]], 1), torch.cat([zero, seen.middle + y * seen.half[1]], 1)
    start, direction, longer = launch(seen.plane, seen.tangent, seen.vergence, x, y)
    front = trace(held.lens, index, start, direction, surfaces=stop + 1)
    inside = (seen.through(index, x, y)[2].amax(0) < 1) & (front.lost == 0)

    def turned(across: Tensor, along: Tensor) -> tuple[Tensor, Tensor]:
        """To the right and up, of what is in the frame of the place."""
        cos, sin = math.cos(turn), math.sin(turn)
        return across * sin + along * cos, along * sin - across * cos

    u, v = turned(front.x / held.lens.stop_radius, front.y / held.lens.stop_radius)
    height, *slope = surface.at(u, v)
    before = index[..., stop + 1]
    own = surface.lifted((front.right.square() + front.up.square()) * before**2)
    taken = surface.lifted(sine * sine)
    across = slope[0] * math.sin(turn) - slope[1] * math.cos(turn)
    along = slope[0] * math.cos(turn) + slope[1] * math.sin(turn)
    push = own / (MM * held.lens.stop_radius * before)
    bent = _behind(seen, front, index, across * push, along * push)
    chief = _behind(seen, front, index, 0 * along, 0 * along)
    (s, t, path), (_, up, straight) = (
        (side, top, longer + front.path + rays.path - back)
        for rays in (bent, chief)
        for side, top, back in [on_sphere(held, rays, seen.landing[:, 0])]
    )
    right, upward = turned(s * held.scale, (t - up[:, :1]) * held.scale)
    there = in_stop(wave, right, upward, turn)
    _, *other = surface.at(*there)
    between = sum((a + b) / 2 * (to - of) for a, b, to, of in zip(slope, other, (u, v), there, strict=True))
    added = (own - taken) * height + taken * between
    off = path - straight[:, :1] - delay(wave, right, upward, turn) + added / MM
    off = off[inside & off.isfinite()]
    return float((off - off.mean()).square().mean().sqrt()) * MM / wavelength


def _behind(seen: Pupil, front: Rays, index: Tensor, right: Tensor, up: Tensor) -> Rays:
    """Rays on the sensor's plane, with their paths from the stop, whose direction cosines there grow."""
    lens, count = seen.held.lens, seen.held.lens.stop + 1
    right, up = front.right + right, front.up + up
    along = torch.sqrt(1 - right.square() - up.square())
    if count == len(lens):
        rays = replace(front, right=right, up=up, along=along, path=torch.zeros_like(right))
    else:
        behind = Stack(
            lens.curvature[count:],
            lens.conic[count:],
            lens.even[count:],
            lens.odd[count:],
            lens.thickness[count:],
            lens.clear[count:],
            0,
            math.nan,
            lens.media[count:],
        )
        start = front.x, front.y, torch.zeros_like(right) - lens.thickness[count - 1]
        rays = trace(behind, index[..., count:], start, (right, up, along))
    return rays.to_plane(seen.held.sensor)
