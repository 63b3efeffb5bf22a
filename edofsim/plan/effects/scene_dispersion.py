"""Dispersion of scene glass: behind dispersive glass each wavelength takes its own way, one band a path."""

from __future__ import annotations

from ...capture.fidelity import disperses
from ..effect import Effect, Errors, Level
from ..facts import Facts

CUTS = {"scene_dispersion": False}


def absent(facts: Facts) -> str:
    if facts.recipe is None or facts.recipe.source is not None:
        return "the light of this view is not rendered here"
    return "" if disperses(facts.recipe) else "no glass in the scene disperses light"


def levels(facts: Facts) -> list[Level]:
    return [
        Level("one index for all bands", CUTS),
        Level("behind the glass alone", {}),
    ]


def error(facts: Facts, level: Level) -> Errors:
    return facts.plain_glass if level.change and facts.plain_glass else (0.0,) * len(facts.response)


def why(facts: Facts) -> str:
    return f"glass bends each wavelength differently ({', '.join(disperses(facts.scene))})"


EFFECT = Effect(
    "dispersion of scene glass",
    levels,
    why,
    absent,
    error=error,
    added="bias",
    stage="render",
    cuts=CUTS,
)
