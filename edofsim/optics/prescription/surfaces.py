"""A lens as its surfaces: the recipe's tables, and the numbers that rays are traced by. Lengths in
millimetres."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated

import torch
from pydantic import Field
from torch import Tensor

from ...errors import InputError
from ...recipe.base import Positive, RecipeModel
from ..materials import Material, material
from .moves import Move

LINES = {"d": 587.56, "F": 486.13, "C": 656.27, "g": 435.83}
"""Fraunhofer's lines, nm."""
NORMAL_LINE = (0.6438, -0.001682)
"""Of the partial dispersion P_gF over the Abbe number, of most glasses: SCHOTT TIE-29."""
MODEL_NM = (380.0, 780.0)
"""Where glass that is known by nd and Vd alone can be used."""


class Surface(RecipeModel):
    """A surface that is round about the axis, and what follows it on the way of the light. Without glass,
    that is air; without a radius, it is a plane."""

    radius_mm: float | None = None
    """radius of curvature at the axis, mm; positive if the centre is behind it; left out for a plane"""
    thickness_mm: float = 0.0
    """way on the axis to the next surface, mm; of the last one, the focus decides"""
    glass: str | None = None
    """name of the glass that follows"""
    nd: Annotated[float, Field(gt=1, lt=5)] | None = None
    """index at 587.6 nm of the glass that follows, where no name is known; with `vd`"""
    vd: Positive | None = None
    """its Abbe number"""
    sellmeier: Annotated[tuple[tuple[float, float], ...], Field(max_length=6)] = ()
    """B and C of each term of its Sellmeier formula, C in um^2, in place of `nd` and `vd`"""
    wavelengths_nm: tuple[Positive, Positive] = MODEL_NM
    """wavelengths that the formula, or `nd` and `vd`, hold for, nm"""
    conic: float = 0.0
    """conic constant: 0 is a sphere, -1 a paraboloid"""
    aspheres_mm: Annotated[tuple[float, ...], Field(max_length=16)] = ()
    """what is added to the sag: factors of r^2, r^4, r^6, ..., in mm to the power -1, -3, -5, ..."""
    odd_aspheres_mm: Annotated[tuple[float, ...], Field(max_length=16)] = ()
    """the same of r^3, r^5, r^7, ..., in mm to the power -2, -4, -6, ..."""
    clear_radius_mm: Positive | None = None
    """distance from the axis that light passes within, mm; left out where nothing is in its way"""
    stop: bool = False
    """whether the aperture stop is here"""

    def medium(self) -> Material | None:
        """What follows; None for air. Raises InputError for a glass that there is not."""
        if self.glass is not None:
            return material(self.glass)
        if self.sellmeier:
            low, high = self.wavelengths_nm
            return Material(
                "glass", "Sellmeier formula of the recipe", low * 1e-9, high * 1e-9, self.sellmeier
            )
        if self.nd is None or self.vd is None:
            return None
        return by_abbe(self.nd, self.vd, self.wavelengths_nm)

    def problems(self, key: str) -> list[str]:
        """Why there can be no such surface; each names the key of the recipe."""
        found: list[str] = []
        if self.radius_mm == 0:
            found.append(f"{key}.radius_mm = 0: leave it out for a plane")
        if (self.nd is None) != (self.vd is None):
            found.append(f"{key}: nd and vd come together")
        if (self.glass is not None) + bool(self.sellmeier) + (self.nd is not None) > 1:
            found.append(f"{key}: more than one of glass, sellmeier and nd; give one")
        if self.wavelengths_nm[0] >= self.wavelengths_nm[1]:
            found.append(f"{key}.wavelengths_nm: the shortest comes first")
        if found:
            return found
        try:
            medium = self.medium()
        except InputError as error:
            return [f"{key}.glass: {problem}" for problem in error.problems]
        if medium is not None:
            ends = torch.tensor([medium.shortest, medium.longest], dtype=torch.float64)
            if not bool((medium.index(ends) >= 1).all()):  # NaN where the formula has a pole
                found.append(f"{key}: this glass has no index above 1 at the ends of its wavelengths")
        return found


def by_abbe(nd: float, vd: float, wavelengths_nm: tuple[float, float] = MODEL_NM) -> Material:
    """Glass that is known by its index and Abbe number: Cauchy's formula through n_d, n_F - n_C and the
    partial dispersion of the normal line."""
    rows, values = [[1.0, 1e6 / LINES["d"] ** 2, 1e12 / LINES["d"] ** 4]], [nd]
    main = (nd - 1) / vd
    partial = NORMAL_LINE[0] + NORMAL_LINE[1] * vd
    for first, second, difference in (("F", "C", main), ("g", "F", main * partial)):
        terms = [1e3**power * (LINES[first] ** -power - LINES[second] ** -power) for power in (2, 4)]
        rows.append([0.0, *terms])
        values.append(difference)
    solved = torch.linalg.solve(
        torch.tensor(rows, dtype=torch.float64), torch.tensor(values, dtype=torch.float64)
    )
    a, b, c = solved.tolist()
    low, high = wavelengths_nm
    return Material(
        f"glass {nd:g}/{vd:g}", "nd and Vd of the recipe", low * 1e-9, high * 1e-9, cauchy=(a, b, c)
    )


@dataclass(frozen=True, eq=False)
class Stack:
    """Surfaces as numbers, float64: curvature, conic [surface], aspheres [surface, term] of r^2, r^4, ...,
    thickness [surface], the last of which is not used.

    clear: radii that light passes within, None where nothing is in its way.
    stop: number of the stop.
    stop_radius: of its opening, NaN where it is not known yet.
    media: what follows each surface, None for air.
    moves: of surfaces by number that are not in their places; pupils and focus are those of all in place.
    """

    curvature: Tensor
    conic: Tensor
    even: Tensor
    odd: Tensor
    thickness: Tensor
    clear: tuple[float | None, ...]
    stop: int
    stop_radius: float
    media: tuple[Material | None, ...]
    moves: Mapping[int, Move] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.media)

    def index(self, wavelengths: Tensor) -> Tensor:
        """Indices [wavelength, surface + 1] at wavelengths [m] before, between and behind the surfaces.

        wavelengths: [wavelength], metres.

        Raises InputError outside the data of a glass.
        """
        air = torch.ones_like(wavelengths)
        known = {medium: medium.index(wavelengths) for medium in set(self.media) if medium is not None}
        return torch.stack([air, *(air if medium is None else known[medium] for medium in self.media)], -1)


def stack(surfaces: Sequence[Surface], scale: float = 1.0) -> Stack:
    """Surfaces of a recipe as numbers, lengths times `scale`. They have no `problems`, and one is the
    stop."""
    number = next(number for number, each in enumerate(surfaces) if each.stop)
    clear = [None if each.clear_radius_mm is None else each.clear_radius_mm * scale for each in surfaces]
    opening = clear[number]
    return Stack(
        torch.tensor(
            [0.0 if each.radius_mm is None else 1 / (each.radius_mm * scale) for each in surfaces],
            dtype=torch.float64,
        ),
        torch.tensor([each.conic for each in surfaces], dtype=torch.float64),
        _factors([each.aspheres_mm for each in surfaces], scale, 1),
        _factors([each.odd_aspheres_mm for each in surfaces], scale, 2),
        torch.tensor([each.thickness_mm * scale for each in surfaces], dtype=torch.float64),
        tuple(clear),
        number,
        float("nan") if opening is None else opening,
        tuple(each.medium() for each in surfaces),
    )


def _factors(rows: Sequence[Sequence[float]], scale: float, first: int) -> Tensor:
    """Factors of aspheres [surface, term] with lengths times `scale`; first: the power of 1 / mm of the
    first."""
    terms = max(len(row) for row in rows)
    found = torch.zeros(len(rows), terms, dtype=torch.float64)
    for number, row in enumerate(rows):
        for term, value in enumerate(row):
            found[number, term] = value * scale ** (-first - 2 * term)
    return found
