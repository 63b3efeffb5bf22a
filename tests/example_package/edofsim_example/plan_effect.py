"""An effect of a plan: whether the dark level of the sensor is simulated."""

from __future__ import annotations

from dataclasses import replace

from edofsim.optics import Camera
from edofsim.plan.effect import Errors
from edofsim.plugins import Effect, Facts, Level, Simplification

from .sensor_effect import DarkLevel


def without_dark_level(camera: Camera) -> Camera:
    """The camera with a sensor that is black in the dark."""
    sensor = camera.recipe.sensor
    others = tuple(effect for effect in sensor.effects if not isinstance(effect, DarkLevel))
    recipe = camera.recipe.model_copy(update={"sensor": sensor.model_copy(update={"effects": others})})
    return replace(camera, recipe=recipe)


def level_of(facts: Facts) -> float:
    found = (effect for effect in facts.camera.recipe.sensor.effects if isinstance(effect, DarkLevel))
    return sum(effect.level for effect in found)


def absent(facts: Facts) -> str:
    return "" if level_of(facts) else "the sensor is black in the dark"


def levels(facts: Facts) -> list[Level]:
    left_out = Simplification("dark level", without_dark_level)
    return [Level("none", {"simplifications": (left_out,)}), Level("added", {})]


def error(facts: Facts, level: Level) -> Errors:
    return (level_of(facts) if level.change else 0.0,) * 3


def why(facts: Facts) -> str:
    return f"the sensor shows {level_of(facts):g} of full scale in the dark"


EFFECT = Effect("dark level", levels, why, absent, error=error, added="bias", stage="sensor")
