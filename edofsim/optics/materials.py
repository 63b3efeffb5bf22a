"""Refractive indices of the glasses and resists that lenses and masks are made of.

All indices are relative to air (that is how the sources measure them), so air itself is exactly 1 and the
phase of a height h is 2 pi / lambda (n - 1) h, Akpinar et al., Eq. `dtophi`.
"""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TypeVar

import torch
from torch import Tensor

from ..errors import InputError

Metres = TypeVar("Metres", Tensor, float)


@dataclass(frozen=True)
class Material:
    """A dispersion formula with its source and the wavelengths it was fitted to.

    sellmeier: pairs (B, C) of n^2 = 1 + sum B l^2 / (l^2 - C); cauchy: (a, b, c) of n = a + b / l^2 + c /
    l^4; l is the wavelength in micrometres, C in its square. shortest, longest: metres.
    """

    name: str
    source: str
    shortest: float
    longest: float
    sellmeier: tuple[tuple[float, float], ...] = ()
    cauchy: tuple[float, float, float] = (1.0, 0.0, 0.0)

    @property
    def formula(self) -> tuple[object, ...]:
        """What the index follows from, whatever the material is called."""
        return self.sellmeier, self.cauchy, self.shortest, self.longest

    def index(self, wavelengths: Tensor | float) -> Tensor:
        """Refractive index, float64, same shape as `wavelengths` [m]. Raises InputError outside the range."""
        if isinstance(wavelengths, float) and self.shortest <= wavelengths <= self.longest:
            return torch.tensor(self._index(wavelengths), dtype=torch.float64)  # many times as quick
        wavelengths = torch.as_tensor(wavelengths, dtype=torch.float64)
        outside = (wavelengths < self.shortest - 1e-12) | (wavelengths > self.longest + 1e-12)
        if not bool(torch.isfinite(wavelengths).all()) or bool(outside.any()):
            wrong = wavelengths.flatten()[(outside | ~torch.isfinite(wavelengths)).flatten()][0]
            raise InputError(
                f"wavelength {float(wrong) * 1e9:g} nm is outside the data of {self.name}"
                f" ({self.shortest * 1e9:g} to {self.longest * 1e9:g} nm, {self.source});"
                " choose wavelengths inside it or another material"
            )
        return self._index(wavelengths)

    def _index(self, wavelengths: Metres) -> Metres:
        square = (wavelengths * 1e6) ** 2
        if self.sellmeier:
            return (1 + sum(b * square / (square - c) for b, c in self.sellmeier)) ** 0.5
        a, b, c = self.cauchy
        return a + b / square + c / square**2


_ALL = (
    Material("air", "reference medium of all sources here", 185e-9, 2000e-9),
    Material(
        "fused-silica",
        "I. H. Malitson, J. Opt. Soc. Am. 55, 1205 (1965)",
        210e-9,
        3710e-9,
        ((0.6961663, 0.0684043**2), (0.4079426, 0.1162414**2), (0.8974794, 9.896161**2)),
    ),
    Material(
        "N-BK7",
        "SCHOTT optical glass data sheet N-BK7 517642.251",
        300e-9,
        2500e-9,
        ((1.03961212, 0.00600069867), (0.231792344, 0.0200179144), (1.01046945, 103.560653)),
    ),
    Material(
        "N-BAF10",
        "SCHOTT optical glass data sheet N-BAF10 670471.375",
        365e-9,
        2325e-9,
        ((1.5851495, 0.00926681282), (0.143559385, 0.0424489805), (1.08521269, 105.613573)),
    ),
    Material(
        "N-SF10",
        "SCHOTT optical glass data sheet N-SF10 728285.305",
        365e-9,
        2325e-9,
        ((1.62153902, 0.0122241457), (0.256287842, 0.0595736775), (1.64447552, 147.468793)),
    ),
    Material(
        "PMMA",
        "M. Szczurowski, refractiveindex.info (2013)",
        404.7e-9,
        1083e-9,
        ((0.99654, 0.00787), (0.18964, 0.02191), (0.00411, 3.85727)),
    ),
    Material(
        "NOA61",
        "Norland Optical Adhesive 61 data sheet (Cauchy)",
        365e-9,
        2200e-9,
        cauchy=(1.5375, 8290.45e-6, -2.11046e-4),
    ),
    Material(
        "S1813",
        "Dow Microposit S1800 G2 data sheet (Cauchy fit to its bleached resist, 300 to 498 nm, carried on)",
        390e-9,
        760e-9,
        cauchy=(1.5935, 1.8854e-2, 4.1211e-6),
    ),
)
MATERIALS: Mapping[str, Material] = MappingProxyType({material.name: material for material in _ALL})


def material(name: str) -> Material:
    """The material of that name. Raises InputError with the nearest known one."""
    if name in MATERIALS:
        return MATERIALS[name]
    by_lower = {known.lower(): known for known in MATERIALS}
    near = difflib.get_close_matches(name.lower(), by_lower, 1, 0.4)
    hint = f"did you mean {by_lower[near[0]]!r}? " if near else ""
    raise InputError(f"unknown material {name!r}; {hint}known: {', '.join(MATERIALS)}")
