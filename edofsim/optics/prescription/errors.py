"""How the wave behind a lens changes where the lens is not made as designed: to first order, by the rays of
the lens as designed, and exactly, by rays of its own. Lengths in millimetres, angles in radians.

A path between two fixed points is stationary: it grows by (n d - n' d') . shift where a surface is moved, d
and d' being the ray's directions there, by the way in a glass whose index grows, and by nothing else in first
order. Fixed are the point of the scene and the place on the reference sphere, whose centre stays where it is.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import torch
from torch import Tensor

from .aim import on_sphere
from .moves import Move
from .polynomials import REACH, basis, fit
from .pupil import Pupil
from .surfaces import Stack
from .trace import Hit
from .waves import Sample, Wave, sample, starts

CENTRE, INDEX, RADIUS, SPACING, TILT, FOCUS = "decentre", "index", "radius", "spacing", "tilt", "focus"


@dataclass(frozen=True)
class Errors:
    """What is wrong with a lens, each by the number of its element or surface. decentre: (right, up) of an
    element; tilt: its turn about the axes (right, up); spacing: how much longer the way behind a surface is,
    where what lies before it is shifted; index: of the medium behind a surface; radius: relative; focus: how
    far the sensor is behind its place."""

    decentre: Mapping[int, tuple[float, float]] = field(default_factory=dict)
    tilt: Mapping[int, tuple[float, float]] = field(default_factory=dict)
    spacing: Mapping[int, float] = field(default_factory=dict)
    index: Mapping[int, float] = field(default_factory=dict)
    radius: Mapping[int, float] = field(default_factory=dict)
    focus: float = 0.0

    def turned(self, sine: float, cosine: float) -> Errors:
        """The same in the frame of a place in the field: (across, along it) in place of (right, up)."""

        def turn(vectors: Mapping[int, tuple[float, float]]) -> dict[int, tuple[float, float]]:
            return {k: (x * sine - y * cosine, x * cosine + y * sine) for k, (x, y) in vectors.items()}

        return replace(self, decentre=turn(self.decentre), tilt=turn(self.tilt))


def elements_of(lens: Stack) -> list[tuple[int, ...]]:
    """Surfaces of each element: those with glass between them, cemented ones together."""
    found: list[tuple[int, ...]] = []
    for number, medium in enumerate(lens.media):
        if medium is not None and not (number and lens.media[number - 1] is not None):
            found.append((number,))
        if number and lens.media[number - 1] is not None:
            found[-1] += (number,)
    return found


def pivots(lens: Stack, element: Sequence[int]) -> dict[int, float]:
    """Where the middle of an element is, from the vertex of each of its surfaces on."""
    places = {number: float(lens.thickness[element[0] : number].sum()) for number in element}
    middle = places[element[-1]] / 2
    return {number: middle - place for number, place in places.items()}


def with_errors(lens: Stack, errors: Errors) -> Stack:
    """The lens as it is made: surfaces moved and bent. Indices are no part of it: `through` adds them."""
    elements = elements_of(lens)
    moves: dict[int, Move] = {}
    for number in range(len(lens)):
        before = -sum(longer for gap, longer in errors.spacing.items() if gap >= number)
        moves[number] = Move((0.0, 0.0, before))
    for number, element in enumerate(elements):
        x, y = errors.decentre.get(number, (0.0, 0.0))
        turn = (*errors.tilt.get(number, (0.0, 0.0)), 0.0)
        for surface, pivot in pivots(lens, element).items():
            moves[surface] = Move((x, y, moves[surface].shift[2]), turn, pivot)
    stretch = torch.tensor([1 + errors.radius.get(k, 0.0) for k in range(len(lens))], dtype=torch.float64)
    moved = {number: move for number, move in moves.items() if move.shift != (0, 0, 0) or any(move.turn)}
    return replace(lens, curvature=lens.curvature / stretch, moves=moved)


@dataclass(frozen=True, eq=False)
class Slopes:
    """How the path [mm] changes with each error of a lens, from one place in the field at one wavelength.

    rays: of the lens as designed. names: (kind, number) of each error. even [ray, error]: of those that leave
    the wave mirrored about the plane of the field: an element's decentre along the field, its tilt about the
    axis across it, and all that has no direction. odd: of the others, an element's decentre across the field
    and its tilt about the axis along it; 0 for errors without a direction.
    """

    rays: Sample
    names: tuple[tuple[str, int], ...]
    even: Tensor
    odd: Tensor

    def amounts(self, errors: Errors) -> tuple[Tensor, Tensor]:
        """Factors [error] of the even and odd changes, of errors in the frame of the place."""
        even, odd = torch.zeros(2, len(self.names), dtype=torch.float64)
        for place, (kind, number) in enumerate(self.names):
            if kind == CENTRE:
                odd[place], even[place] = errors.decentre.get(number, (0.0, 0.0))
            elif kind == TILT:
                even[place], odd[place] = errors.tilt.get(number, (0.0, 0.0))
            elif kind == FOCUS:
                even[place] = errors.focus
            else:
                known = {SPACING: errors.spacing, INDEX: errors.index, RADIUS: errors.radius}[kind]
                even[place] = known.get(number, 0.0)
        return even, odd


def slopes(seen: Pupil, wavelength: float) -> Slopes:
    """Of one place in the field, at a wavelength [m]. Raises InputError outside the data of a glass."""
    hits: list[Hit] = []
    rays = sample(seen, torch.tensor([wavelength], dtype=torch.float64), hits)
    lens = seen.held.lens
    across, along, axial = (
        torch.stack([-hit.bent[0] * hit.normal[axis][0] for hit in hits]) for axis in range(3)
    )
    even: dict[tuple[str, int], Tensor] = {}
    odd: dict[tuple[str, int], Tensor] = {}
    for number, element in enumerate(elements_of(lens)):
        some = list(element)
        even[CENTRE, number], odd[CENTRE, number] = along[some].sum(0), across[some].sum(0)
        about_across, about_along = torch.zeros(2, along.shape[-1], dtype=torch.float64)
        for surface, pivot in pivots(lens, element).items():
            x, y, z = (each[0] for each in hits[surface].place)
            about_across = about_across + axial[surface] * y - along[surface] * (z - pivot)
            about_along = about_along + across[surface] * (z - pivot) - axial[surface] * x
        even[TILT, number], odd[TILT, number] = about_across, about_along
    for gap in range(len(lens) - 1):
        even[SPACING, gap] = -axial[: gap + 1].sum(0)
        if lens.media[gap] is not None:
            even[INDEX, gap] = hits[gap + 1].way[0]
    for surface in range(len(lens)):
        even[RADIUS, surface] = -axial[surface] * _stretched(lens, surface, hits[surface])
    even[FOCUS, 0] = rays.slant[0]
    used, none = rays.used[0][:, None], torch.zeros_like(rays.slant[0])
    mirrored = torch.stack([each - each[0] for each in even.values()], -1).where(used, 0.0)
    turned = torch.stack([odd.get(name, none) for name in even], -1).where(used, 0.0)
    return Slopes(rays, tuple(even), mirrored, turned)


def _stretched(lens: Stack, surface: int, hit: Hit) -> Tensor:
    """By how much the sag of a surface falls as its radius grows, relative, at rays: c dz/dc of the conic."""
    c, k = float(lens.curvature[surface]), float(lens.conic[surface])
    squared = (hit.place[0].square() + hit.place[1].square())[0]
    root = torch.sqrt((1 - (1 + k) * c * c * squared).clamp_min(1e-30))
    return c * squared / (root * (1 + root))


@dataclass(frozen=True, eq=False)
class Change:
    """What is added to the path [mm]: polynomials in the disc of a wave, [term, 1], the odd one times the
    place across."""

    even: Tensor
    odd: Tensor


def first_order(found: Slopes, errors: Errors) -> Tensor:
    """The change of the path [mm] at the rays of `found`, and at their mirror images, [2, ray]."""
    even, odd = (
        part @ amounts for part, amounts in zip((found.even, found.odd), found.amounts(errors), strict=True)
    )
    return torch.stack([even + odd, even - odd])


def fitted_slopes(found: Slopes) -> tuple[Tensor, Tensor]:
    """Polynomials [term, error] of the even and the odd changes with each error."""
    rays = found.rays
    even = fit(rays.a, rays.b, rays.weight, found.even[None])[0]
    return even, fit(rays.a, rays.b, rays.weight, found.odd[None], odd=True)[0]


@dataclass(frozen=True, eq=False)
class Exact:
    """The change of the path [mm] at rays through a lens as it is made, and at rays that start mirrored, all
    [2, ray]; where they are in the disc of the wave, a and b; weight: of each in a fit, 0 of lost ones."""

    change: Tensor
    a: Tensor
    b: Tensor
    weight: Tensor
    half: float

    def fitted(self) -> Change:
        """Polynomials nearest to it."""
        terms = basis(self.a, self.b) * self.weight[..., None]
        both = torch.cat([terms, terms * self.a[..., None]], -1).flatten(0, 1)
        values = (self.change * self.weight).flatten()[:, None]
        even, odd = torch.linalg.lstsq(both, values, driver="gelsd").solution.chunk(2)
        return Change(even, odd)


def exact(seen: Pupil, wavelength: float, wave: Wave, errors: Errors) -> Exact:
    """What `first_order` is the first order of, at the places of its own rays. errors: in the frame of the
    place; wave: of the lens as designed."""
    held, at = seen.held, torch.tensor([wavelength], dtype=torch.float64)
    own = sample(seen, at)
    index = held.lens.index(at)[:, None, :].clone()
    for gap, more in errors.index.items():
        index[..., gap + 1] += more
    made = replace(seen, held=replace(held, lens=with_errors(held.lens, errors)))
    x, y = starts(seen, 1)
    rays, path, _, _ = made.through(index, torch.cat([x, -x]), torch.cat([y, y]))
    across, up, back = on_sphere(held, rays, seen.landing[:, 0].expand(2))
    a = across * held.scale / own.half
    b = ((up - own.up) * held.scale - own.middle) / own.half
    slant = torch.sqrt(1 - across.square() - up.square())
    longer = path - back + errors.focus * slant
    weight = own.weight * (longer.isfinite() & (torch.hypot(a, b) < REACH))
    a, b, longer = (each.where(weight > 0, 0.0) for each in (a, b, longer))
    change = (longer - basis(a, b) @ wave.even[:, 0]).where(weight > 0, 0.0)
    return Exact(change - change[:, :1].mean(), a, b, weight, float(own.half))


def planes(a: Tensor, b: Tensor, weight: Tensor, values: Tensor) -> Tensor:
    """Slopes (across, along) of the planes nearest to values [place, quantity], [2, quantity]: by where what
    is far from their middle moves the image.

    a, b: [place], across and along.
    weight: [place].
    values: [place, quantity].
    """
    root = weight.sqrt()[:, None]
    terms = torch.stack([torch.ones_like(a), a, b], -1) * root
    return torch.linalg.lstsq(terms, values * root, driver="gelsd").solution[1:]
