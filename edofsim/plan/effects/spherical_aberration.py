"""Spherical aberration: what a lens adds to the parabola that defocus is counted from."""

from __future__ import annotations

import math

from ...optics import best_focus_distance, focus_distance
from ..effect import Effect, Level
from ..facts import Facts


def absent(facts: Facts) -> str:
    return "" if facts.camera.lens.aberrates else "the lens has none"


def levels(facts: Facts) -> list[Level]:
    return [Level("parabola", {"spherical_aberration": False}), Level("the lens's own", {})]


def why(facts: Facts) -> str:
    wavelength = float(facts.view.wavelengths.double().mean())
    waves = facts.camera.lens.waves_at_most(wavelength)
    paraxial = float(focus_distance(facts.camera, wavelength))
    best = best_focus_distance(facts.camera, wavelength)
    return (
        f"the wave of the lens departs from a parabola's by {waves:.2g} waves within the aperture, whose"
        f" best focus is at {_metres(best)}, near the axis at {_metres(paraxial)}"
    )


def _metres(distance: float) -> str:
    return f"{distance:.3g} m" if 0 < distance < math.inf else "infinity"


EFFECT = Effect(
    "spherical aberration",
    levels,
    why,
    absent,
    stage="psf",
)
