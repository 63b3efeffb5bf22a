"""What of the pupil is open to light from a place in the field, and how much light that is."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from .polynomials import REACH, values_at, values_on
from .waves import Wave

SAMPLES = 258
"""Across the disc, for the light that gets through."""


def quantities_at(
    wave: Wave, even: Tensor, odd: Tensor, right: Tensor, up: Tensor, turn: float
) -> tuple[Tensor, Tensor]:
    """What polynomials say at places of the pupil, [quantity, ...], and which of these they hold for.

    even, odd: [term, quantity].
    right, up: [1, n] and [m, 1], a grid, or [...], points; mm in the frame of the sensor, that of the field
        runs along (cos turn, sin turn).

    On a grid they are products of small matrices. Beyond, they stay as they are at the edge.
    """
    cosine, sine = math.cos(turn), math.sin(turn)
    x, y = (right - wave.middle * cosine) / wave.half, (up - wave.middle * sine) / wave.half
    holds = torch.hypot(x, y) < REACH
    x, y = x.clamp(-REACH, REACH), y.clamp(-REACH, REACH)
    if x.ndim == 2 and x.shape[0] == 1 and y.shape[1:] == (1,):
        return values_on(even, odd, x[0], y[:, 0], turn), holds
    x, y = torch.broadcast_tensors(x, y)
    return values_at(even, odd, x * sine - y * cosine, x * cosine + y * sine), holds


def delay(wave: Wave, right: Tensor, up: Tensor, turn: float) -> Tensor:
    """Path [mm] beyond the chief ray's at places [mm]; beyond the disc, within what it is in there.

    right: [1, n] or point by point [...], mm.
    up: [m, 1] or point by point [...], mm.
    """
    found, holds = quantities_at(wave, wave.even[:, :1], wave.odd[:, :0], right, up, turn)
    path = found[0]
    if not bool(holds.any()):
        return torch.zeros_like(path)
    return path.clamp(*path[holds].aminmax())


def in_stop(wave: Wave, right: Tensor, up: Tensor, turn: float) -> Tensor:
    """Where rays met the stop, to the right and up, over its radius, [2, ...].

    right: [1, n] or point by point [...], mm.
    up: [m, 1] or point by point [...], mm.
    """
    (along, across), _ = quantities_at(wave, wave.even[:, 1:2], wave.odd, right, up, turn)
    cosine, sine = math.cos(turn), math.sin(turn)
    return torch.stack([across * sine + along * cosine, along * sine - across * cosine])


def opening(wave: Wave, right: Tensor, up: Tensor, turn: float) -> Tensor:
    """Fraction of each cell of a grid that stop and rims let light through, 0 to 1, by how far away each edge
    is; between single places, 0 or 1.

    right: [1, n] or point by point [...], mm.
    up: [m, 1] or point by point [...], mm.
    """
    found, holds = quantities_at(wave, wave.even[:, 1:], wave.odd, right, up, turn)
    share = holds.to(torch.float64)
    for edge in (torch.hypot(found[0], found[-1]), *found[1:-1].clamp_min(0).sqrt()):
        share = share * _grey(edge, right, up)
    return share


def _grey(edge: Tensor, right: Tensor, up: Tensor) -> Tensor:
    """Share of each cell where `edge` is below 1."""
    if edge.ndim != 2 or min(edge.shape) < 3:
        return (edge < 1).to(torch.float64)
    cell = float((right.flatten()[-1] - right.flatten()[0]).abs()) / (right.numel() - 1)
    down, across = torch.gradient(edge, spacing=cell)
    return (0.5 + (1 - edge) / (torch.hypot(down, across) * cell).clamp_min(1e-12)).clamp(0, 1)


def light(wave: Wave, radius: float = math.inf) -> float:
    """Area of the pupil [mm^2] that light gets through, within a radius [mm]: what of a bright sky lands on a
    small part of the sensor is proportional to it."""
    reach = REACH * wave.half
    cell = 2 * reach / SAMPLES
    axis = (torch.arange(SAMPLES, dtype=torch.float64) + 0.5) * cell - reach
    right, up = axis[None, :], (axis + wave.middle)[:, None]
    share = opening(wave, right, up, math.pi / 2)
    if math.isfinite(radius):
        share = torch.minimum(share, disc(right, up, radius, cell))
    return float(share.sum()) * cell * cell


def disc(right: Tensor, up: Tensor, radius: float, cell: float) -> Tensor:
    """Fraction of each cell that a disc covers, by how far away its edge is.

    right: [1, n] or point by point [...], mm.
    up: [m, 1] or point by point [...], mm.
    """
    return (0.5 + (radius - torch.hypot(right, up)) / cell).clamp(0, 1)
