"""Sequential lenses of CODE V, .seq."""

from __future__ import annotations

import re

from ....errors import InputError
from .rows import LensFile, Row, number

UNITS = {"M": 1.0, "C": 10.0, "I": 25.4}
REFUSED = {
    "REFL", "RMD", "XDE", "YDE", "ZDE", "ADE", "BDE", "CDE", "DAR", "BEN", "REV", "SPS", "DIF", "GRT", "HOE",
    "CYL", "YTO", "XTO", "AAS", "PRV", "NSS", "ZOO", "REX", "REY", "ELX", "ELY", "GRX", "XAS", "TOR",
}  # fmt: skip
ASPHERES = {letter: 4 + 2 * place for place, letter in enumerate("ABCDEFGHJ")}
"""Power of r that each letter is the factor of."""
PASSED = {
    "RDM", "LEN", "WL", "WTW", "REF", "WTF", "XAN", "YAN", "XOB", "YOB", "XIM", "YIM", "XRI", "YRI", "INI",
    "ASP", "CCY", "THC", "KC", "AC", "BC", "CC", "DC", "GL2", "GO", "TIT", "TITLE", "SLB", "CA", "PIM", "UM",
    "CON", "SPH", "INS", "END",
}  # fmt: skip
"""Words that say nothing of what is traced."""
VIGNETTING = {"VUX", "VLX", "VUY", "VLY"}


def read(text: str, name: str) -> LensFile:
    """Raises InputError for what is not traced."""
    found, radii, unread = LensFile(), False, set[str]()
    for count, line in enumerate(text.replace("&\n", " ").splitlines(), 1):
        where = f"{name}, line {count}"
        for part in re.split(r";(?=(?:[^']*'[^']*')*[^']*$)", line.partition("!")[0]):
            words = part.split()
            if not words:
                continue
            key = words[0].upper()
            row = found.rows[-1] if found.rows else None
            if key == "RDM":
                radii = words[1:2] != ["N"]
            elif key in ("TIT", "TITLE"):
                found.title = part.partition("'")[2].rstrip("' ")
            elif key == "DIM":
                found.unit = UNITS.get(words[1].upper()[:1] if words[1:] else "", 0.0)
                if not found.unit:
                    raise InputError(f"{where}: {part.strip()}: a unit is M (mm), C or I")
            elif key == "EPD":
                found.opening = ("diameter", number(words, 1, where))
            elif key == "FNO":
                found.opening = ("f-number", number(words, 1, where))
            elif key in ("NA", "NAO"):
                raise InputError(f"{where}: an aperture by {key} is not read; give EPD or FNO")
            elif re.fullmatch(r"S(O|I|\d+)?", key):
                found.rows.append(_surface(words, radii, where))
            elif key in REFUSED or key == "MIR":
                raise InputError(
                    f"{where}: {part.strip()}: not traced; lenses of round, centred surfaces are"
                )
            elif key in VIGNETTING:
                unread.add("vignetting factors (clear radii shut the pupil, where there are any)")
            elif row is None or key in PASSED:
                continue
            elif key == "STO":
                row.stop = True
            elif key == "K":
                row.conic = number(words, 1, where)
            elif key in ASPHERES:
                row.asphere(ASPHERES[key], number(words, 1, where))
            elif key == "CIR" and words[1:2] not in (["EDG"], ["OBS"], ["HOL"]):
                row.clear = number(words, 1, where)
            else:
                unread.add(key)
    if unread:
        found.notes.append(f"left out: {', '.join(sorted(unread))}")
    return found


def _surface(words: list[str], radii: bool, where: str) -> Row:
    shape = number(words, 1, where) if words[1:] else 0.0
    row = Row(curvature=(1 / shape if shape else 0.0) if radii else shape)
    if words[2:]:
        row.thickness = number(words, 2, where)
    if words[3:] and words[3].upper() != "AIR":
        row.glass = words[3]
        if "REFL" in (each.upper() for each in words[3:]):
            raise InputError(f"{where}: mirrors are not traced")
    return row
