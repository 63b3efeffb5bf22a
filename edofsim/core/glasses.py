"""Dispersion of the glasses and resists of lenses, masks and scenes: formulas, their sources and ranges."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from torch import Tensor

Metres = TypeVar("Metres", "Tensor", NDArray[np.float64], float)


@dataclass(frozen=True)
class Glass:
    """A dispersion formula with its source and the wavelengths it was fitted to.

    sellmeier: pairs (B, C) of n^2 = 1 + sum B l^2 / (l^2 - C).
    cauchy: (a, b, c) of n = a + b / l^2 + c / l^4; l is the wavelength in micrometres, C in its square.
    shortest, longest: metres.
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

    def at(self, wavelengths: Metres) -> Metres:
        """The index, unchecked."""
        square = (wavelengths * 1e6) ** 2
        if self.sellmeier:
            return (1 + sum(b * square / (square - c) for b, c in self.sellmeier)) ** 0.5
        a, b, c = self.cauchy
        return a + b / square + c / square**2


_ALL = (
    Glass("air", "reference medium of all sources here", 185e-9, 2000e-9),
    Glass(
        "fused-silica",
        "I. H. Malitson, J. Opt. Soc. Am. 55, 1205 (1965)",
        210e-9,
        3710e-9,
        ((0.6961663, 0.0684043**2), (0.4079426, 0.1162414**2), (0.8974794, 9.896161**2)),
    ),
    Glass(
        "N-BK7",
        "SCHOTT optical glass data sheet N-BK7 517642.251",
        300e-9,
        2500e-9,
        ((1.03961212, 0.00600069867), (0.231792344, 0.0200179144), (1.01046945, 103.560653)),
    ),
    Glass(
        "N-BAF10",
        "SCHOTT optical glass data sheet N-BAF10 670471.375",
        365e-9,
        2325e-9,
        ((1.5851495, 0.00926681282), (0.143559385, 0.0424489805), (1.08521269, 105.613573)),
    ),
    Glass(
        "N-SF10",
        "SCHOTT optical glass data sheet N-SF10 728285.305",
        365e-9,
        2325e-9,
        ((1.62153902, 0.0122241457), (0.256287842, 0.0595736775), (1.64447552, 147.468793)),
    ),
    Glass(
        "N-SF11",
        "SCHOTT optical glass data sheet N-SF11",
        370e-9,
        2500e-9,
        ((1.73759695, 0.013188707), (0.313747346, 0.0623068142), (1.89878101, 155.23629)),
    ),
    Glass(
        "N-F2",
        "SCHOTT optical glass data sheet N-F2",
        334e-9,
        2500e-9,
        ((1.39757037, 0.00995906143), (0.159201403, 0.0546931752), (1.2686543, 119.248346)),
    ),
    Glass(
        "PMMA",
        "M. Szczurowski, refractiveindex.info (2013)",
        404.7e-9,
        1083e-9,
        ((0.99654, 0.00787), (0.18964, 0.02191), (0.00411, 3.85727)),
    ),
    Glass(
        "NOA61",
        "Norland Optical Adhesive 61 data sheet (Cauchy)",
        365e-9,
        2200e-9,
        cauchy=(1.5375, 8290.45e-6, -2.11046e-4),
    ),
    Glass(
        "S1813",
        "Dow Microposit S1800 G2 data sheet (Cauchy fit to its bleached resist, 300 to 498 nm, carried on)",
        390e-9,
        760e-9,
        cauchy=(1.5935, 1.8854e-2, 4.1211e-6),
    ),
)
GLASSES: Mapping[str, Glass] = MappingProxyType({glass.name: glass for glass in _ALL})
