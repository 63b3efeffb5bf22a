"""Shot noise: light comes in electrons."""

from __future__ import annotations

import math

from ..effect import Effect, Errors, Level
from ..facts import Facts


def absent(facts: Facts) -> str:
    return "" if facts.camera.recipe.sensor.full_well_electrons else "the recipe names no full well"


def levels(facts: Facts) -> list[Level]:
    return [Level("none", {"shot_noise": False}), Level("Poisson", {})]


def error(facts: Facts, level: Level) -> Errors:
    """Its variance is the signal over the full well: the mean signal gives the mean square."""
    well = facts.camera.recipe.sensor.full_well_electrons or math.inf
    return tuple((facts.levels_of_light / well).sqrt().tolist()) if level.change else (0.0,) * 3


def why(facts: Facts) -> str:
    return f"full scale is {facts.camera.recipe.sensor.full_well_electrons:g} electrons"


EFFECT = Effect("shot noise", levels, why, absent, error=error, added="noise", stage="sensor")
