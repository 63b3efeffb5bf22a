"""Read noise of the sensor."""

from __future__ import annotations

from ..effect import Effect, Errors, Level
from ..facts import Facts


def absent(facts: Facts) -> str:
    return "" if facts.camera.read_noise else "the recipe asks for none"


def levels(facts: Facts) -> list[Level]:
    return [Level("none", {"read_noise": False}), Level("Gaussian", {})]


def error(facts: Facts, level: Level) -> Errors:
    return (facts.camera.read_noise if level.change else 0.0,) * len(facts.response)


def why(facts: Facts) -> str:
    return f"the recipe asks for {facts.camera.read_noise:g} of full scale"


EFFECT = Effect("read noise", levels, why, absent, error=error, added="noise", stage="sensor")
