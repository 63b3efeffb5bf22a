"""Sequential lenses of Zemax, .zmx."""

from __future__ import annotations

from ....errors import InputError
from .rows import LensFile, Row, number

UNITS = {"MM": 1.0, "CM": 10.0, "IN": 25.4, "INCH": 25.4, "METER": 1000.0, "M": 1000.0}
FIRST_POWER = {"STANDARD": None, "EVENASPH": 2, "ODDASPHE": 1}
"""Power of r that the first parameter of a surface is the factor of."""
NUMBERS = {"CURV": "curvature", "DISZ": "thickness", "CONI": "conic"}
STEP = {"EVENASPH": 2, "ODDASPHE": 1}
VIGNETTING = ("VDXN", "VDYN", "VCXN", "VCYN")


def read(text: str, name: str) -> LensFile:
    """Raises InputError for what is not traced: other kinds of surfaces, mirrors, tilts."""
    found, kinds = LensFile(), list[str]()
    units, automatic, vignetted, unit = None, 0, False, ""
    for count, line in enumerate(text.splitlines(), 1):
        words, where = line.split(), f"{name}, line {count}"
        if not words:
            continue
        key = words[0].upper()
        if key == "SURF":
            found.rows.append(Row())
            kinds.append("STANDARD")
            continue
        here = f"{where} (surface {len(found.rows) - 1})"
        if key == "MODE" and words[1:2] != ["SEQ"]:
            raise InputError(f"{where}: {line.strip()}: only sequential lenses are read")
        if key == "UNIT":
            unit = words[1].upper() if words[1:] else ""
            units = UNITS.get(unit)
        elif key == "NAME":
            found.title = " ".join(words[1:])
        elif key == "ENPD":
            found.opening = ("diameter", number(words, 1, where))
        elif key == "FNUM":
            found.opening = ("f-number", number(words, 1, where))
        elif key == "FLOA":
            found.opening = ("stop", 0.0)
        elif key in ("OBNA", "OBSC"):
            raise InputError(f"{where}: an aperture by {key} is not read; set an entrance pupil diameter")
        elif key == "MNUM" and number(words, 1, where) > 1:
            found.notes.append(f"of {words[1]} configurations, the first as it stands is read")
        elif key in VIGNETTING:
            vignetted |= any(float(each) != 0 for each in words[1:])
        elif found.rows:
            automatic += _of_surface(found, kinds, words, here)
    if units is None:
        raise InputError(f"{name} does not say its unit (UNIT MM, CM, IN or M); it says {unit or 'nothing'}")
    found.unit = units
    if vignetted:
        found.notes.append("vignetting factors are left out: clear radii shut the pupil, where there are any")
    if automatic:
        found.notes.append(f"{automatic} semi-diameters that the program worked out from rays are left out")
    return found


def _of_surface(found: LensFile, kinds: list[str], words: list[str], here: str) -> int:
    """Read a line of the last surface. Returns how many semi-diameters it left out: 0 or 1."""
    key = words[0].upper()
    row = found.rows[-1]
    if key == "TYPE":
        kinds[-1] = words[1].upper() if words[1:] else ""
        if kinds[-1] not in FIRST_POWER:
            known = ", ".join(FIRST_POWER)
            raise InputError(f"{here}: surfaces of type {kinds[-1]} are not traced; {known} are")
    elif key == "STOP":
        row.stop = True
    elif key in NUMBERS:
        setattr(row, NUMBERS[key], number(words, 1, here))
    elif key == "GLAS":
        _glass(row, words, here)
    elif key == "PARM":
        place, factor = int(number(words, 1, here)), number(words, 2, here)
        first = FIRST_POWER[kinds[-1]]
        if first is not None:
            row.asphere(first + STEP[kinds[-1]] * (place - 1), factor)
        elif factor:
            found.notes.append(f"{here}: parameter {place} of a standard surface is left out")
    elif key in ("CLAP", "FLAP"):
        row.clear = number(words, 2, here)
    elif key == "DIAM" and row.clear is None and number(words, 1, here) > 0:
        # 0: the program worked it out from the rays, 1: somebody gave it
        if words[2:3] == ["1"]:
            row.clear = number(words, 1, here)
        else:
            return 1
    elif key in ("SQAP", "ELAP", "OBDC"):
        raise InputError(f"{here}: {key}: openings that are not round about the axis are not traced")
    return 0


def _glass(row: Row, words: list[str], where: str) -> None:
    if words[1:2] == ["MIRROR"]:
        raise InputError(f"{where}: mirrors are not traced")
    row.glass = words[1] if words[1:] else None
    model = words[2:3] == ["1"]  # by index and Abbe number; else these stand for nothing
    if model or row.glass == "___BLANK":
        row.index = (number(words, 4, where), number(words, 5, where))
