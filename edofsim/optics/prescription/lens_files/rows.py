"""What lens files say, whatever program wrote them; lengths in the file's unit until they are scaled."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from ....errors import InputError

UNITS = {"mm": 1.0, "cm": 10.0, "in": 25.4, "m": 1000.0}
"""Millimetres."""


@dataclass
class Row:
    """A surface.

    even: factors of r^2, r^4, ...
    odd: of r^3, r^5, ...
    glass: a name, with nd and vd where the file says them.
    clear: radius that light passes within.
    """

    curvature: float = 0.0
    thickness: float = 0.0
    glass: str | None = None
    index: tuple[float, float] | None = None
    conic: float = 0.0
    even: list[float] = field(default_factory=list)
    odd: list[float] = field(default_factory=list)
    clear: float | None = None
    stop: bool = False

    def asphere(self, power: int, factor: float) -> None:
        """Add a factor of r^power. Raises InputError for powers that are not round about the axis."""
        if factor == 0:
            return
        if power < 2:
            raise InputError(f"a term r^{power} of an asphere makes a cone, which is not traced")
        terms, place = (self.even, power // 2 - 1) if power % 2 == 0 else (self.odd, (power - 3) // 2)
        terms += [0.0] * (place + 1 - len(terms))
        terms[place] += factor

    def scaled(self, unit: float) -> Row:
        """In millimetres."""
        return Row(
            self.curvature / unit,
            self.thickness * unit,
            self.glass,
            self.index,
            self.conic,
            [each * unit ** (-1 - 2 * n) for n, each in enumerate(self.even)],
            [each * unit ** (-2 - 2 * n) for n, each in enumerate(self.odd)],
            None if self.clear is None else self.clear * unit,
            self.stop,
        )


@dataclass
class LensFile:
    """A lens as a file has it, from the object to the image.

    unit: millimetres.
    opening: what says how wide it is, "diameter" of the entrance pupil, "f-number", or "stop" for the clear
        radius there.
    notes: what was not read or is not as it seems, a sentence each.
    """

    title: str = ""
    unit: float = 1.0
    rows: list[Row] = field(default_factory=list)
    opening: tuple[str, float] = ("", math.nan)
    notes: list[str] = field(default_factory=list)


def number(words: list[str], place: int, where: str) -> float:
    """A number among words. Raises InputError that names the line."""
    try:
        found = float(words[place].replace("D", "E").replace("d", "e"))
    except (IndexError, ValueError):
        raise InputError(f"{where}: {' '.join(words)!r} needs a number") from None
    if math.isnan(found):
        raise InputError(f"{where}: {' '.join(words)!r} is not a number")
    return found
