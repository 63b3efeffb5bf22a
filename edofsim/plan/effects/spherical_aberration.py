"""Spherical aberration: what a lens adds to the parabola that defocus is counted from."""

from __future__ import annotations

from ..effect import Effect, Level
from ..facts import Facts


def absent(facts: Facts) -> str:
    return "" if facts.camera.lens.aberrates else "the lens has none"


def levels(facts: Facts) -> list[Level]:
    return [Level("parabola", {"spherical_aberration": False}), Level("the lens's own", {})]


def why(facts: Facts) -> str:
    waves = facts.camera.lens.waves_at_most(float(facts.view.wavelengths.double().mean()))
    return f"the wave of the lens departs from a parabola's by {waves:.2g} waves within the aperture"


EFFECT = Effect(
    "spherical aberration",
    levels,
    why,
    absent,
    stage="psf",
)
