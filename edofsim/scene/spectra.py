"""Spectra at the wavelengths of a view: reflectances, illuminants, metals, and photographs.

All spectra come from colour-science, except the optical constants of metals, which are the measured
tables that ship with Mitsuba (data/ior). Wavelengths are metres, results float64 [band].
"""

from __future__ import annotations

import difflib
import importlib.util
import re
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..core.glasses import GLASSES
from ..core.images import srgb_decode
from ..core.tables import kept_tables
from ..errors import InputError

if TYPE_CHECKING:
    import colour

MAX_EXTRAPOLATION = 60e-9
"""How far a measured reflectance is continued as a constant beyond its data, in metres. The patches and
surfaces in colour-science end at 700 to 780 nm, where the spectra are flat."""

_METALS = {
    "aluminium": "Al",
    "silver": "Ag",
    "gold": "Au",
    "copper": "Cu",
    "chromium": "Cr",
    "tungsten": "W",
    "iridium": "Ir",
    "nickel": "Ni_palik",
    "titanium nitride": "TiN",
}


def _unknown(what: str, name: str, known: list[str]) -> InputError:
    near = difflib.get_close_matches(name.lower(), [n.lower() for n in known], n=3, cutoff=0.4)
    listed = [n for n in known if n.lower() in near] or sorted(known)[:12]
    word = "nearest" if near else "known"
    return InputError(f"unknown {what} {name!r}; {word}: {', '.join(map(repr, listed))}")


def _inside(nm: np.ndarray, first: float, last: float, slack_nm: float, what: str) -> None:
    low, high = first - slack_nm, last + slack_nm
    if nm.min() < low - 1e-6 or nm.max() > high + 1e-6:
        raise InputError(
            f"{what} has data from {first:g} to {last:g} nm, but the bands reach from {nm.min():g} to "
            f"{nm.max():g} nm; choose bands inside the data or another spectrum"
        )


def _interpolated(table: np.ndarray, wavelengths: np.ndarray, slack: float, what: str) -> np.ndarray:
    """Linear interpolation of a table of `rows_of`, constant for `slack` metres beyond its ends.

    Returns [band] of the first of its curves.
    """
    nm = np.asarray(wavelengths, float) * 1e9
    x, y = table[:2]
    _inside(nm, x[0], x[-1], slack * 1e9, what)
    return np.interp(nm, x, y)


def rows_of(sd: colour.SpectralDistribution | colour.MultiSpectralDistributions) -> np.ndarray:
    """Wavelengths (nm) and the curves of a spectrum of colour-science, float64 [1 + curve, n]."""
    return np.vstack([np.asarray(sd.wavelengths, float), np.asarray(sd.values, float).T])


def observer() -> np.ndarray:
    """Wavelengths (nm) and the three colour matching functions of CIE 1931, [4, n]."""

    def make() -> dict[str, np.ndarray]:
        from colour import MSDS_CMFS

        return {"": rows_of(MSDS_CMFS["CIE 1931 2 Degree Standard Observer"])}

    return kept_tables("observer of CIE 1931", make)[""]


def _measured_surfaces() -> dict[str, colour.SpectralDistribution]:
    from colour import SDS_COLOURCHECKERS

    found: dict[str, colour.SpectralDistribution] = {}
    for sds in (SDS_COLOURCHECKERS["PMC"], SDS_COLOURCHECKERS["ColorChecker N Ohta"]):
        found.update({name.lower(): sd for name, sd in sds.items()})
    # The names of the neutral patches carry their densities; the plain words find them too.
    for name in ("white 9.5", "neutral 8", "neutral 6.5", "neutral 5", "neutral 3.5", "black 2"):
        found[name] = next(sd for key, sd in found.items() if key.startswith(name + " ("))
    return found


def color_checker(wavelengths: np.ndarray) -> dict[str, np.ndarray]:
    """Measured reflectances of the 24 patches (N. Ohta, in colour-science), in the chart's order.

    wavelengths: [band] m.

    Returns name -> float64 [band]. Raises InputError outside 320 to 840 nm.
    """

    def make() -> dict[str, np.ndarray]:
        from colour import SDS_COLOURCHECKERS

        return {name: rows_of(sd) for name, sd in SDS_COLOURCHECKERS["ColorChecker N Ohta"].items()}

    return {
        name: _interpolated(table, wavelengths, MAX_EXTRAPOLATION, f"the patch {name!r}")
        for name, table in kept_tables("patches of N. Ohta", make).items()
    }


def srgb_basis(wavelengths: np.ndarray) -> np.ndarray:
    """The three reflectances of Mallett and Yuksel (EGSR 2019), float64 [3, band], for linear sRGB.

    wavelengths: [band], metres.

    They sum to 1 at every wavelength, so that white is white and no reflectance exceeds 1.
    """

    def make() -> dict[str, np.ndarray]:
        from colour.recovery import MSDS_BASIS_FUNCTIONS_sRGB_MALLETT2019

        return {"": rows_of(MSDS_BASIS_FUNCTIONS_sRGB_MALLETT2019)}

    nm = np.asarray(wavelengths, float) * 1e9
    _inside(nm, 380, 780, MAX_EXTRAPOLATION * 1e9, "the basis for sRGB photographs (Mallett and Yuksel)")
    x, *columns = kept_tables("basis for sRGB of Mallett and Yuksel", make)[""]
    basis = np.stack([np.interp(nm, x, column) for column in columns])
    return basis / basis.sum(axis=0)


def upsampled(linear: np.ndarray, wavelengths: np.ndarray, light: str = "D65") -> np.ndarray:
    """Linear sRGB [y, x, 3] as light [band, y, x], float32: the colours' smooth reflectances (see
    `srgb_basis`) under an illuminant.

    linear: [y, x, 3], linear sRGB.
    wavelengths: [band], metres.

    Raises InputError for an unknown illuminant, and for wavelengths beyond the data.
    """
    basis = srgb_basis(wavelengths) * illuminant(light, wavelengths)
    return np.ascontiguousarray(np.moveaxis(linear @ basis, -1, 0), np.float32)


def srgb_weights(wavelengths: np.ndarray) -> np.ndarray:
    """What turns light at `wavelengths` into linear sRGB as the eye sees it, float64 [3, band].

    wavelengths: [band], metres.

    By the observer of CIE 1931; the illuminant D65 comes out white, (1, 1, 1), however few the bands are.
    """

    def make() -> dict[str, np.ndarray]:
        from colour import RGB_COLOURSPACES

        return {"": RGB_COLOURSPACES["sRGB"].matrix_XYZ_to_RGB}

    nm = np.asarray(wavelengths, float) * 1e9
    x, *columns = observer()
    matching = np.stack([np.interp(nm, x, column) for column in columns])
    weights = kept_tables("XYZ to sRGB", make)[""] @ matching
    white = weights @ illuminant("D65", wavelengths)
    if (white <= 0).any():  # too few bands to tell colours apart: all is grey
        weights = np.broadcast_to(matching[1] + 1e-9, weights.shape)
        white = weights @ illuminant("D65", wavelengths)
    return weights / white[:, None]


def hex_to_linear(text: str) -> np.ndarray:
    """`#rrggbb` to linear sRGB, float64 [3]. Raises InputError for anything else."""
    if not re.fullmatch(r"#[0-9a-fA-F]{6}", text):
        raise InputError(f"colour {text!r} is not of the form #rrggbb (six hexadecimal digits)")
    return srgb_decode(np.array([int(text[i : i + 2], 16) for i in (1, 3, 5)]) / 255)


def reflectance(value: float | str, wavelengths: np.ndarray) -> np.ndarray:
    """A reflectance at `wavelengths` ([band], m), float64 [band] in [0, 1].

    value: a number, `#rrggbb`, or the name of a measured surface.
    wavelengths: [band], metres.

    Raises InputError for an unknown name (with the nearest ones) and for wavelengths further than 60 nm
    beyond the measured data.
    """
    if isinstance(value, int | float):
        return np.full(len(wavelengths), float(value))
    if value.startswith("#"):
        return hex_to_linear(value) @ srgb_basis(wavelengths)

    def make() -> dict[str, np.ndarray]:
        return {name: rows_of(sd) for name, sd in _measured_surfaces().items()}

    surfaces = kept_tables("measured surfaces", make)
    if value.lower() not in surfaces:
        raise _unknown("reflectance", value, list(surfaces))
    table = surfaces[value.lower()]
    return np.clip(_interpolated(table, wavelengths, MAX_EXTRAPOLATION, f"the reflectance {value!r}"), 0, 1)


def luminance(values: np.ndarray, nm: np.ndarray) -> float:
    """Mean of a spectrum weighted by the eye's sensitivity (CIE 1931): 1 for the constant spectrum 1.

    values, nm: [n], equally spaced wavelengths in nanometres.
    """
    x, _, sensitivity, _ = observer()
    weight = np.interp(nm, x, sensitivity)
    return float((weight * values).sum() / weight.sum())


def _luminance_normalised(table: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Wavelengths (nm) and values of `rows_of` scaled to the luminance of the constant spectrum 1.

    The scale is taken from the whole spectrum, so that it does not depend on the bands of a view.
    """
    x, y = table
    nm = np.arange(max(380, x[0]), min(780, x[-1]) + 0.5)
    return x, y / luminance(np.interp(nm, x, y), nm)


def illuminant(name: str, wavelengths: np.ndarray) -> np.ndarray:
    """Relative spectrum of an illuminant or light source of colour-science, float64 [band].

    wavelengths: [band], metres.

    Scaled so that its luminance is that of the constant spectrum 1. No value is invented outside the
    data: raises InputError there, and for unknown names (with the nearest ones).
    """

    def make() -> dict[str, np.ndarray]:
        from colour import SDS_ILLUMINANTS, SDS_LIGHT_SOURCES

        known: dict[str, colour.SpectralDistribution] = {}
        for key, entry in (*SDS_LIGHT_SOURCES.items(), *SDS_ILLUMINANTS.items()):
            group = entry.items() if hasattr(entry, "items") else [(key, entry)]
            known.update({str(key): sd for key, sd in group})
        by_lower = {key.lower(): sd for key, sd in known.items()}
        if name.lower() not in by_lower:
            raise _unknown("illuminant", name, list(known))
        return {"": rows_of(by_lower[name.lower()])}

    x, y = _luminance_normalised(kept_tables(f"illuminant {name.lower()}", make)[""])
    nm = np.asarray(wavelengths, float) * 1e9
    _inside(nm, x[0], x[-1], 0, f"the illuminant {name!r}")
    return np.interp(nm, x, y)


def daylight(cct_k: float, wavelengths: np.ndarray) -> np.ndarray:
    """CIE daylight of a correlated colour temperature (4000 to 25000 K), scaled as `illuminant`.

    wavelengths: [band], metres.

    Raises InputError for temperatures outside the definition of the CIE.
    """

    def make() -> dict[str, np.ndarray]:
        from colour import sd_CIE_illuminant_D_series
        from colour.temperature import CCT_to_xy_CIE_D

        return {"": rows_of(sd_CIE_illuminant_D_series(CCT_to_xy_CIE_D(cct_k)))}

    if not 4000 <= cct_k <= 25000:
        raise InputError(f"daylight of {cct_k:g} K is not defined by the CIE: choose 4000 to 25000 K")
    x, y = _luminance_normalised(kept_tables(f"daylight {float(cct_k)!r}", make)[""])
    nm = np.asarray(wavelengths, float) * 1e9
    _inside(nm, x[0], x[-1], 0, f"daylight of {cct_k:g} K")
    return np.interp(nm, x, y)


def _optical_constant(path: Path, wavelengths: np.ndarray, what: str) -> np.ndarray:
    table = np.loadtxt(path, comments="#")
    x, y = table[np.argsort(table[:, 0])].T
    nm = np.asarray(wavelengths, float) * 1e9
    _inside(nm, x[0], x[-1], 0, what)
    return np.interp(nm, x, y)


def metal(name: str, wavelengths: np.ndarray) -> np.ndarray:
    """Reflectance of a bare metal at normal incidence, ((n-1)^2 + k^2) / ((n+1)^2 + k^2), float64 [band].

    wavelengths: [band], metres.

    n and k are the measured tables that ship with Mitsuba. Raises InputError for unknown metals and for
    wavelengths outside the tables.
    """
    if name.lower() not in _METALS:
        raise _unknown("metal", name, list(_METALS))
    return metal_by_symbol(_METALS[name.lower()], wavelengths)


def metal_by_symbol(stem: str, wavelengths: np.ndarray) -> np.ndarray:
    """As `metal`, for the name of one of Mitsuba's tables (`Au`, `Cu_palik`).

    wavelengths: [band], metres.

    Raises InputError for an unknown table.
    """
    package = importlib.util.find_spec("mitsuba")  # finds the folder without importing the package
    if package is None or package.origin is None:
        raise InputError("the optical constants of metals come with Mitsuba, which is not installed")
    folder = Path(package.origin).parent / "data" / "ior"
    known = {path.name.removesuffix(".eta.spd") for path in folder.glob("*.eta.spd")}
    if stem not in known:
        raise _unknown("metal", stem, sorted(known))
    what = f"the metal {stem!r}"
    n = _optical_constant(folder / f"{stem}.eta.spd", wavelengths, what)
    k = _optical_constant(folder / f"{stem}.k.spd", wavelengths, what)
    return ((n - 1) ** 2 + k**2) / ((n + 1) ** 2 + k**2)


def refractive_index(glass: str, wavelengths: np.ndarray) -> np.ndarray:
    """Refractive index of one of `core.glasses`, float64 [band].

    wavelengths: [band], metres.

    Raises InputError for an unknown glass and for wavelengths outside its fit.
    """
    by_lower = {name.lower(): known for name, known in GLASSES.items()}
    if glass.lower() not in by_lower:
        raise _unknown("glass", glass, list(GLASSES))
    found = by_lower[glass.lower()]
    at = np.asarray(wavelengths, float)
    _inside(at * 1e9, found.shortest * 1e9, found.longest * 1e9, 0, f"the glass {found.name!r}")
    return found.at(at)
