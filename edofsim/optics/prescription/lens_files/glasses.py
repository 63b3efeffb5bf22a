"""Glass by name: known here, from catalogues of makers (.agf), by the code in its name, or as given."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from ....core.limits import existing
from ....errors import InputError
from ...materials import MATERIALS
from .rows import number

SELLMEIER = 2
"""Formula of a catalogue that is taken as it is; of glass by others, n_d and V_d."""
OTHERS = {
    1: "Schott",
    3: "Herzberger",
    4: "Sellmeier 2",
    5: "Conrady",
    6: "Sellmeier 3",
    7: "Handbook of Optics 1",
    8: "Handbook of Optics 2",
    9: "Sellmeier 4",
    10: "Extended",
    11: "Sellmeier 5",
    12: "Extended 2",
    13: "Extended 3",
}
CODE = re.compile(r"(\d{3})(\d{3})|(\d{3,6})\.(\d{2})(\d*)")


def catalogue(path: Path) -> dict[str, dict[str, object]]:
    """Keys of surfaces by the name of a glass, from a catalogue of Zemax's form, and `formula`, the name of
    one that is not read. Raises InputError."""
    existing(path, "--glasses")
    content = path.read_bytes()
    text = (
        content.decode("utf-16") if content[:2] in (b"\xff\xfe", b"\xfe\xff") else content.decode("latin-1")
    )
    found: dict[str, dict[str, object]] = {}
    named, formula = "", 0
    for count, line in enumerate(text.splitlines(), 1):
        words, where = line.split(), f"{path}, line {count}"
        if words[:1] == ["NM"] and len(words) > 5:
            named, formula = words[1].upper(), int(number(words, 2, where))
            found[named] = {"nd": number(words, 4, where), "vd": number(words, 5, where)}
            if formula != SELLMEIER:
                found[named]["formula"] = OTHERS.get(formula, f"number {formula}")
        elif words[:1] == ["CD"] and named and formula == SELLMEIER:
            values = [number(words, place, where) for place in range(1, min(len(words), 7))]
            pairs = zip(values[::2], values[1::2], strict=False)
            found[named] = {"sellmeier": tuple((b, c) for b, c in pairs if b)}
        elif words[:1] == ["LD"] and named:
            ends = (number(words, 1, where) * 1e3, number(words, 2, where) * 1e3)
            if "sellmeier" in found[named]:
                found[named]["wavelengths_nm"] = ends
    if not found:
        raise InputError(f"--glasses {path}: holds no glass; a catalogue has lines NM, CD and LD (.agf)")
    return found


def keys_of(
    name: str,
    index: tuple[float, float] | None,
    glasses_by_name: Mapping[str, tuple[float, float]],
    catalogues: Sequence[Mapping[str, dict[str, object]]],
) -> tuple[dict[str, object], str]:
    """Keys of a surface for a glass, and a note where they are less than its data. Raises InputError for one
    that is not known."""
    plain = re.sub(r"_(SCHOTT|OHARA|HOYA|CDGM|CORNING|SUMITA|HIKARI|PLASTIC|SPECIAL)$", "", name.upper())
    if plain in glasses_by_name:
        return {"nd": glasses_by_name[plain][0], "vd": glasses_by_name[plain][1]}, ""
    for known in catalogues:
        if plain in known:
            keys = dict(known[plain])
            formula = keys.pop("formula", None)
            said = f"glass {name} by nd and Vd: formula {formula} of its catalogue is not read"
            return keys, said if formula else ""
    by_upper = {each.upper(): each for each in MATERIALS}
    if plain in by_upper and plain != "AIR":
        return {"glass": by_upper[plain]}, ""
    if index is not None:
        return {"nd": index[0], "vd": index[1]}, f"glass {name} by nd and Vd of the file alone"
    code = CODE.fullmatch(plain)
    if code:
        digits, abbe = (
            code[1] or code[3],
            f"{code[2][:2]}.{code[2][2]}" if code[2] else f"{code[4]}.{code[5]}0",
        )
        nd, vd = float(("2." if digits[0] == "0" else "1.") + digits), float(abbe)
        return {"nd": nd, "vd": vd}, f"glass {name} by the index and Abbe number in its code"
    raise InputError(
        f"glass {name} is not known here: give its maker's catalogue, --glasses FILE.agf, or its index and"
        f" Abbe number, --glass {plain}=ND,VD"
    )
