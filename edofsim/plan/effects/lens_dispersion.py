"""Dispersion of the lens: each wavelength focuses elsewhere."""

from __future__ import annotations

from ..effect import Effect, Level
from ..facts import Facts


def absent(facts: Facts) -> str:
    if not facts.camera.lens.disperses:
        return "the lens refracts all wavelengths alike"
    return "the view holds one band" if facts.view.bands == 1 else ""


def levels(facts: Facts) -> list[Level]:
    at = facts.camera.recipe.focus.wavelength_nm
    return [Level(f"refracts as at {at:g} nm", {"lens_dispersion": False}), Level("each wavelength", {})]


def why(facts: Facts) -> str:
    first, last = (float(w) for w in facts.view.wavelengths[[0, -1]])
    power = [1 / float(facts.camera.lens.focal_length(w)) for w in (first, last)]
    return f"the lens's power changes by {power[0] - power[1]:.2f} dioptres from {facts.nm()}"


EFFECT = Effect(
    "dispersion of the lens",
    levels,
    why,
    absent,
    stage="psf",
)
