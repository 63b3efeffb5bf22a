"""Refractive indices of the glasses and resists that lenses and masks are made of.

All indices are relative to air (that is how the sources measure them), so air itself is exactly 1 and the
phase of a height h is 2 pi / lambda (n - 1) h, Akpinar et al., Eq. `dtophi`.
"""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import torch
from torch import Tensor

from ..core.glasses import GLASSES, Glass
from ..errors import InputError


@dataclass(frozen=True)
class Material(Glass):
    """A glass or resist of optics."""

    def index(self, wavelengths: Tensor | float) -> Tensor:
        """Refractive index, float64, same shape as `wavelengths` [m].

        wavelengths: any shape [...], metres.

        Raises InputError outside the range.
        """
        if isinstance(wavelengths, float) and self.shortest <= wavelengths <= self.longest:
            return torch.tensor(self.at(wavelengths), dtype=torch.float64)  # many times as quick
        wavelengths = torch.as_tensor(wavelengths, dtype=torch.float64)
        outside = (wavelengths < self.shortest - 1e-12) | (wavelengths > self.longest + 1e-12)
        if not bool(torch.isfinite(wavelengths).all()) or bool(outside.any()):
            wrong = wavelengths.flatten()[(outside | ~torch.isfinite(wavelengths)).flatten()][0]
            raise InputError(
                f"wavelength {float(wrong) * 1e9:g} nm is outside the data of {self.name}"
                f" ({self.shortest * 1e9:g} to {self.longest * 1e9:g} nm, {self.source});"
                " choose wavelengths inside it or another material"
            )
        return self.at(wavelengths)


MATERIALS: Mapping[str, Material] = MappingProxyType(
    {name: Material(**vars(glass)) for name, glass in GLASSES.items()}
)


def material(name: str) -> Material:
    """The material of that name. Raises InputError with the nearest known one."""
    if name in MATERIALS:
        return MATERIALS[name]
    by_lower = {known.lower(): known for known in MATERIALS}
    near = difflib.get_close_matches(name.lower(), by_lower, 1, 0.4)
    hint = f"did you mean {by_lower[near[0]]!r}? " if near else ""
    raise InputError(f"unknown material {name!r}; {hint}known: {', '.join(MATERIALS)}")
