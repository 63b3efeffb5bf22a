"""Rays through the surfaces of a lens, one after the other: float64, batched, differentiable.
 Light goes along z. Conics are met in closed form, aspheres by Newton's method; a last step of it outside of
the iteration carries the derivative of the implicit equation. Lost rays end as NaN.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import torch
from torch import Tensor

from .surfaces import Stack

STEPS = 20
"""Of Newton's method at most."""
FEWEST = 6
"""Of them, before a ray whose steps do not halve is given up."""
CLOSE = 1e-12
"""Its last step, in millimetres."""
FOUND = 1e-9
"""A longer last step does not lead to the surface."""
TINY = 1e-30
"""Below roots of what is not there."""
REASONS = (
    "miss surface {}",
    "are totally reflected at surface {}",
    "leave the glass before surface {} where it has no thickness left",
)

Shape = tuple[float | Tensor, float | Tensor, list[float] | list[Tensor], list[float] | list[Tensor]]


@dataclass(frozen=True)
class Hit:
    """Rays [batch, ray] at a surface: place from its vertex, way there in the medium before it, normal of
    length 1 along the light, and by how much of it the direction times the index grows."""

    place: tuple[Tensor, Tensor, Tensor]
    way: Tensor
    normal: tuple[Tensor, Tensor, Tensor]
    bent: Tensor


@dataclass(frozen=True)
class Rays:
    """Rays behind the last surface, each [batch, ray]: place (x, y) on its vertex plane, direction (right,
    up, along), optical path since the start.

    at: place (x, y) on each surface that was asked for.
    lost: 0, or 1 + number of the surface that a ray was lost at + surfaces times the number of the reason.
    """

    x: Tensor
    y: Tensor
    right: Tensor
    up: Tensor
    along: Tensor
    path: Tensor
    at: dict[int, tuple[Tensor, Tensor]]
    lost: Tensor

    def to_plane(self, distance: Tensor | float) -> Rays:
        """The same rays on a plane so far behind.

        distance: scalar [] or [batch, ray], mm.
        """
        way = distance / self.along
        return Rays(
            self.x + way * self.right,
            self.y + way * self.up,
            self.right,
            self.up,
            self.along,
            self.path + way,
            self.at,
            self.lost,
        )


def trace(
    lens: Stack,
    index: Tensor,
    start: tuple[Tensor, Tensor, Tensor],
    direction: tuple[Tensor, Tensor, Tensor],
    keep: Collection[int] = (),
    surfaces: int | None = None,
    hits: list[Hit] | None = None,
) -> Rays:
    """Rays from `start` (x, y, z from the first vertex), each [batch, ray], through a lens in air.

    index: [batch, 1, surface + 1], of the ray's wavelength.
    start: x, y, z from the first vertex, [batch, ray] each.
    direction: cosines along x, y, z, [batch, ray] each.
    keep: surfaces whose places are kept.
    surfaces: how many are met, None for all.
    hits: gets what happens at each.

    Gradients reach the start and the tensors of the lens. Places on a surface that is moved are those that it
    sees.
    """
    x, y, z = start
    right, up, along = direction
    path = torch.zeros_like(x + right)
    lost = torch.zeros_like(path, dtype=torch.long)
    at: dict[int, tuple[Tensor, Tensor]] = {}
    count = len(lens)
    last = count if surfaces is None else surfaces
    for number in range(last):
        before, after = index[..., number], index[..., number + 1]
        move = lens.moves.get(number)
        if move:
            (x, y, z), (right, up, along) = move.into((x, y, z), (right, up, along))
        flat = -z / along  # to the vertex plane, then to the surface
        x, y = x + flat * right, y + flat * up
        more, met, (x, y, z), normal = _meet(lens, number, (x, y), (right, up, along), lost == 0)
        way = flat + more
        path = path + before * way
        if number in keep:
            at[number] = x, y
        cosine = normal[0] * right + normal[1] * up + normal[2] * along
        ratio = before / after
        square = 1 - ratio.square() * (1 - cosine.square())
        hollow = (before > 1) & (way < -CLOSE) & (number > 0)
        for reason, true in enumerate((~met, square <= 0, hollow)):
            lost = torch.where((lost == 0) & true, 1 + number + reason * count, lost)
        bent = torch.sqrt(square.clamp_min(TINY)) - ratio * cosine
        right, up, along = (ratio * old + bent * n for old, n in zip((right, up, along), normal, strict=True))
        if hits is not None:
            hits.append(Hit((x, y, z), way, normal, after * bent))
        if move:
            (x, y, z), (right, up, along) = move.back((x, y, z), (right, up, along))
        if number + 1 < last:
            z = z - lens.thickness[number]
    way = -z / along
    found = torch.stack([x + way * right, y + way * up, right, up, along, path + index[..., last] * way])
    # lost rays went on as finite numbers until here, so that gradients of the others stay finite
    x, y, right, up, along, path = torch.where(lost == 0, found, torch.nan)
    return Rays(x, y, right, up, along, path, at, lost)


def why_lost(lens: Stack, lost: Tensor) -> str:
    """In words, of what most of the lost rays [ray] did; surfaces count from 0, as in a recipe.

    lost: [batch, ray].
    """
    codes = lost[lost > 0] - 1
    code = int(codes.mode().values)
    return REASONS[code // len(lens)].format(code % len(lens))


def _plain(values: Tensor) -> list[float] | list[Tensor]:
    """Numbers as they are quickest: tensors only where gradients reach them."""
    return list(values.unbind()) if values.requires_grad else values.tolist()


def _shape(lens: Stack, number: int) -> Shape:
    """Curvature, conic, even and odd aspheres of a surface."""
    ends = slice(number, number + 1)
    (c,), (k,) = _plain(lens.curvature[ends]), _plain(lens.conic[ends])
    return c, k, _plain(lens.even[number]), _plain(lens.odd[number])


def sag_and_slope(shape: Shape, squared: Tensor) -> tuple[Tensor, Tensor]:
    """How far a surface lies behind its vertex at squared distances from the axis, and how fast that grows
    with the distance, over the distance.

    shape: its curvature, conic, even and odd aspheres.
    squared: any shape [...], mm^2.
    """
    c, k, even, odd = shape
    root = torch.sqrt((1 - squared * ((1 + k) * c * c)).clamp_min(TINY))
    sag, slope = squared * c / (1 + root), c / root
    height, steep = _series(even, squared, 2)
    if any(odd):
        radius = squared.clamp_min(TINY).sqrt()
        odd_height, odd_steep = _series(odd, squared, 3)
        height, steep = height + odd_height * radius, steep + odd_steep * radius
    return sag + height * squared, slope + steep


def _series(factors: list[float] | list[Tensor], squared: Tensor, first: int) -> tuple[Tensor, Tensor]:
    """sum f_i q^i, and the same of f_i (first + 2 i), by Horner's scheme."""
    total, steeper = torch.zeros_like(squared), torch.zeros_like(squared)
    for term in range(len(factors) - 1, -1, -1):
        total = total * squared + factors[term]
        steeper = steeper * squared + (first + 2 * term) * factors[term]
    return total, steeper


def _meet(
    lens: Stack,
    number: int,
    place: tuple[Tensor, Tensor],
    direction: tuple[Tensor, Tensor, Tensor],
    wanted: Tensor,
) -> tuple[Tensor, Tensor, tuple[Tensor, Tensor, Tensor], tuple[Tensor, Tensor, Tensor]]:
    """Way from the vertex plane to the surface, whether the ray meets it, where, and the normal of length 1
    there."""
    (x, y), (right, up, along) = place, direction
    shape = c, k, even, odd = _shape(lens, number)
    foot = along - c * (right * x + up * y)
    left = c * (x.square() + y.square())
    root = foot.square() - c * (1 + k * along.square()) * left
    met = root > 0
    way = left / (foot + torch.sqrt(root.clamp_min(TINY)))
    aspheric = any(even) or any(odd)
    if aspheric:
        way, found = _newton(shape, place, direction, way, wanted & met)
        met = met & found
    x, y, z = x + way * right, y + way * up, way * along
    if aspheric:
        _, slope = sag_and_slope(shape, x.square() + y.square())
        normal = -slope * x, -slope * y, torch.ones_like(x)
    else:
        normal = -c * x, -c * y, 1 - c * (1 + k) * z
    scale = torch.rsqrt(normal[0].square() + normal[1].square() + normal[2].square())
    return way, met, (x, y, z), (normal[0] * scale, normal[1] * scale, normal[2] * scale)


def _newton(
    shape: Shape,
    place: tuple[Tensor, Tensor],
    direction: tuple[Tensor, Tensor, Tensor],
    way: Tensor,
    wanted: Tensor,
) -> tuple[Tensor, Tensor]:
    """Way to an aspheric surface, from that to its conic on, and whether it was found; steps go on for rays
    that are wanted, as long as theirs shrink."""
    (x, y), (right, up, along) = place, direction
    squared, slanted, across = x.square() + y.square(), x * right + y * up, right.square() + up.square()

    def step(way: Tensor) -> Tensor:
        outwards = slanted + way * across  # half of what the square of the distance grows by along the ray
        sag, slope = sag_and_slope(shape, squared + way * (slanted + outwards))
        return (way * along - sag) / (along - slope * outwards)

    with torch.no_grad():
        known = way
        moved = torch.full_like(known, torch.inf)
        for count in range(STEPS):
            last, moved = moved, step(known)
            known = known - moved
            far = wanted & (moved.abs() > CLOSE)
            if count >= FEWEST:
                far &= moved.abs() < last.abs() / 2
            if not bool(far.any()):
                break
        found = moved.abs() < FOUND
        known = torch.where(found, known, way)
    return known - torch.where(found, step(known), 0.0), found
