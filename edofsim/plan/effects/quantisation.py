"""Quantisation by the sensor's converter."""

from __future__ import annotations

from ..effect import Effect, Errors, Level
from ..facts import Facts


def absent(facts: Facts) -> str:
    return "" if facts.camera.recipe.sensor.bits else "the recipe names no number of bits"


def levels(facts: Facts) -> list[Level]:
    return [Level("none", {"quantisation": False}), Level(f"{facts.camera.recipe.sensor.bits} bits", {})]


def error(facts: Facts, level: Level) -> Errors:
    """Rounding to steps of q errs by q / sqrt(12)."""
    step = 1 / (2 ** (facts.camera.recipe.sensor.bits or 1) - 1)
    return (step / 12**0.5 if level.change else 0.0,) * len(facts.response)


def why(facts: Facts) -> str:
    return f"the converter has {facts.camera.recipe.sensor.bits} bits"


EFFECT = Effect("quantisation", levels, why, absent, error=error, added="noise", stage="sensor")
