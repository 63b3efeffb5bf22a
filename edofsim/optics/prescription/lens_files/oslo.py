"""Lenses of OSLO, .len."""

from __future__ import annotations

from ....errors import InputError
from .rows import LensFile, Row, number

ASPHERES = {"AD": 4, "AE": 6, "AF": 8, "AG": 10}
NUMBERS = {"CV": "curvature", "TH": "thickness", "CC": "conic"}
REFUSED = {"RFL", "RFH", "TLA", "TLB", "TLC", "DCX", "DCY", "DCZ", "TCE", "GRX", "DT", "BEN", "PFL", "CVX"}
PASSED = {
    "ANG", "DES", "WV", "WW", "RST", "F", "LEN", "WRSP", "ASP", "DLRS", "SDAD", "DLMN", "DLFD", "CSD", "LSD",
    "RCO", "GC", "EBR",
}  # fmt: skip


def read(text: str, name: str) -> LensFile:
    """Raises InputError for what is not traced."""
    found, unread = LensFile(rows=[Row()]), set[str]()
    begun = ended = False
    for count, line in enumerate(text.splitlines(), 1):
        words, where = line.partition("//")[0].split(), f"{name}, line {count}"
        if not words or ended:
            continue
        key, row = words[0].upper(), found.rows[-1]
        if key == "LEN":
            begun = True
            found.title = line.partition('"')[2].partition('"')[0]
        elif key == "UNI":
            found.unit = number(words, 1, where)
        elif key == "EBR":
            found.opening = ("diameter", 2 * number(words, 1, where))
        elif key == "NXT":
            found.rows.append(Row())
        elif key in ("WV", "END"):
            ended = key == "END"
        elif key in REFUSED:
            raise InputError(f"{where}: {line.strip()}: not traced; lenses of round, centred surfaces are")
        elif key == "RD":
            radius = number(words, 1, where)
            row.curvature = 1 / radius if radius else 0.0
        elif key in NUMBERS:
            setattr(row, NUMBERS[key], number(words, 1, where))
        elif key in ASPHERES:
            row.asphere(ASPHERES[key], number(words, 1, where))
        elif key == "AST":
            row.stop = True
        elif key == "AP":
            # CHK: rays beyond are stopped; else it is what is drawn
            if "CHK" in (each.upper() for each in words[1:]):
                row.clear = number([each for each in words if each.upper() != "CHK"], 1, where)
        elif key == "GLA":
            row.glass = words[1] if words[1:] else None
            if len(words) > 3 and words[1].upper() in ("MODEL", "FIXED"):
                row.index = (number(words, 2, where), number(words, 3, where))
        elif key == "AIR" or key in PASSED:
            continue
        else:
            unread.add(key)
    if not begun:
        raise InputError(f"{name} is no lens of OSLO: it has no line LEN NEW")
    if len(found.rows) > 1 and not any(row.stop for row in found.rows):
        found.rows[1].stop = True  # what OSLO takes where none is named
    if unread:
        found.notes.append(f"left out: {', '.join(sorted(unread))}")
    return found
