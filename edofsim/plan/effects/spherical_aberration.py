"""Exact lens: the sphere departs from its parabola, which is spherical aberration."""

from __future__ import annotations

import math

from ..effect import Effect, Level
from ..facts import Facts


def absent(facts: Facts) -> str:
    return "" if facts.camera.recipe.lens.thickness == "exact" else "the recipe asks for a parabolic lens"


def levels(facts: Facts) -> list[Level]:
    return [Level("parabola", {"spherical_aberration": False}), Level("exact sag", {})]


def waves(facts: Facts) -> float:
    """Waves by which the sphere departs from its parabola at the rim."""
    camera = facts.camera
    r, radius = camera.aperture_radius, camera.radius_of_curvature
    beyond = radius - math.sqrt(radius**2 - r**2) - r**2 / (2 * radius)
    wavelength = float(facts.view.wavelengths.double().mean())
    return (float(camera.glass.index(wavelength)) - 1) * beyond / wavelength


def why(facts: Facts) -> str:
    return f"the sphere departs from its parabola by {waves(facts):.2g} waves at the rim of the aperture"


EFFECT = Effect(
    "spherical aberration",
    levels,
    why,
    absent,
    sample={"band_groups": 1, "group_wavelengths": 3, "layers": 9, "snapped": True},
    stage="psf",
)
