"""Which wavelengths the bands of a spectral cube have: what the recipe says, what the file says, and
units."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from ..errors import InputError
from ..recipe.sources import CubeFile

NANOMETRES = {"nm": 1.0, "um": 1e3, "angstrom": 0.1, "m": 1e9}
UNIT_WORDS = {
    "nm": "nm", "nanometer": "nm", "nanometers": "nm", "nanometre": "nm", "nanometres": "nm",
    "um": "um", "µm": "um", "μm": "um", "micron": "um", "microns": "um", "micrometer": "um",
    "micrometers": "um", "micrometre": "um", "micrometres": "um",
    "a": "angstrom", "å": "angstrom", "angstrom": "angstrom", "angstroms": "angstrom",
    "m": "m", "meter": "m", "meters": "m", "metre": "m", "metres": "m",
}  # fmt: skip
"""What files call the units, in lower case."""
UNIT_KEY = 'wavelength_unit = "nm", "um", "angstrom" or "m"'
NAMED = re.compile(r"(\d+(?:[.,]\d+)?)[ _-]?(nm|um|µm|μm)(?![a-z])", re.IGNORECASE)
PLAIN_NM = (300, 1100)
"""Bare numbers in names are wavelengths only within these."""


def natural(name: str) -> tuple[tuple[int, int, str], ...]:
    """What sorts names with their numbers as numbers: band2 before band10."""
    parts = re.split(r"(\d+)", name.lower())
    return tuple((0, int(part), part) if part.isdigit() else (1, 0, part) for part in parts if part)


def of_names(names: Sequence[str]) -> tuple[np.ndarray | None, str | None]:
    """Wavelengths that names such as 415nm state, and their unit; (None, None) where they state none.

    Bare numbers count as nm where one number changes from name to name, in steps of more than 1, from 300 to
    1100.
    """
    found = [NAMED.findall(name) for name in names]
    if all(len(each) == 1 for each in found):
        units = {UNIT_WORDS[each[0][1].lower()] for each in found}
        if len(units) == 1:
            return np.array([float(each[0][0].replace(",", ".")) for each in found]), units.pop()
    numbers = [[int(digits) for digits in re.findall(r"\d+", name)] for name in names]
    if len(names) < 2 or len({len(each) for each in numbers}) != 1:
        return None, None
    columns = [np.array(column) for column in zip(*numbers, strict=True) if len(set(column)) > 1]
    if len(columns) != 1 or len(set(columns[0].tolist())) != len(names):
        return None, None
    low, high = columns[0].min(), columns[0].max()
    if low < PLAIN_NM[0] or high > PLAIN_NM[1] or np.diff(np.sort(columns[0])).min() < 2:
        return None, None
    return columns[0].astype(float), "nm"


def unit_of(words: str | None) -> str | None:
    """The unit that a file names, None for one that is not known."""
    return UNIT_WORDS.get((words or "").strip().lower())


def in_nm(values: np.ndarray, unit: str | None, what: str) -> tuple[np.ndarray, str]:
    """Wavelengths in nm, and the unit that they were in.

    values: [band].
    unit: None where nobody says; then numbers from 100 to 2600 are nm, from 0.1 to 100 micrometres, and below
        0.001 metres.

    Raises InputError for others, which asks.
    """
    values = np.asarray(values, float)
    if values.size == 0 or not np.isfinite(values).all() or not (values > 0).all():
        raise InputError(f"{what}: its wavelengths are not all finite and above 0")
    if unit is None:
        low, high = values.min(), values.max()
        if high < 1e-3:
            unit = "m"
        elif low >= 0.1 and high < 100:
            unit = "um"
        elif low >= 100 and high <= 2600:
            unit = "nm"
        else:
            raise InputError(
                f"{what}: its wavelengths go from {low:g} to {high:g} in no stated unit; {UNIT_KEY}"
            )
    return values * NANOMETRES[unit], unit


def chosen_nm(
    source: CubeFile, found: np.ndarray | None, unit: str | None, count: int, what: str
) -> tuple[np.ndarray, str]:
    """Wavelengths of `count` bands in nm, in the file's order, and a phrase that says where they come from.

    found: [band], what the file says; None where it says nothing.
    unit: what the file says.

    Raises InputError where nobody says, and for two bands of one wavelength.
    """
    stored, taken = None, ""
    if found is not None and len(found) == count:
        try:
            stored, taken = in_nm(found, source.wavelength_unit or unit, what)
        except InputError:
            if source.wavelengths_nm is None and source.start_nm is None:
                raise
    if source.wavelengths_nm is not None:
        nm, said = np.array(source.wavelengths_nm), "wavelengths_nm"
        if len(nm) != count:
            raise InputError(f"{what} has {count} bands, and wavelengths_nm {len(nm)}; give one for each")
    elif source.start_nm is not None and source.step_nm is not None:
        nm, said = source.start_nm + source.step_nm * np.arange(count), "start_nm and step_nm"
        if not (nm > 0).all():
            raise InputError(f"{what}: start_nm and step_nm lead to {nm.min():g} nm at its {count} bands")
    elif stored is not None:
        nm, said = stored, f"the file, in {taken}"
    else:
        other = "" if found is None else f" (it lists {len(found)})"
        raise InputError(
            f"{what} does not say which wavelengths its {count} bands have{other}; give start_nm and "
            "step_nm, "
            "or wavelengths_nm"
        )
    if len(np.unique(nm)) < count:
        raise InputError(f"{what}: two of its bands have the same wavelength")
    if stored is not None and np.abs(stored - nm).max() > 0.5:
        said += f", not the file's {stored.min():g} to {stored.max():g} nm"
    return nm, f"{nm[0]:g} to {nm[-1]:g} nm, by {said}"
