"""Dispersion of the DOE: one height delays each wavelength by another phase, beyond 1 / wavelength."""

from __future__ import annotations

from ..effect import Effect, Level
from ..facts import Facts


def absent(facts: Facts) -> str:
    if facts.camera.height_map is None and not hasattr(facts.camera.recipe.mask, "design_wavelength_nm"):
        return "the aperture holds no relief"
    return "the view holds one band" if facts.view.bands == 1 else ""


def levels(facts: Facts) -> list[Level]:
    return [Level("refracts the same", {"doe_dispersion": False}), Level("each wavelength", {})]


def why(facts: Facts) -> str:
    first, last = (float(facts.camera.mask_material.index(float(w))) for w in facts.view.wavelengths[[0, -1]])
    return f"{facts.camera.mask_material.name} has the index {first:.3f} to {last:.3f} over {facts.nm()}"


EFFECT = Effect(
    "dispersion of the DOE",
    levels,
    why,
    absent,
    stage="psf",
)
