"""An effect of a plan: how finely the dark current of the sensor is simulated."""

from __future__ import annotations

from dataclasses import replace

from edofsim import Camera
from edofsim.plugins import Effect, Errors, Facts, Level, Simplification

from .sensor_effect import DarkCurrent


def of(camera: Camera) -> list[DarkCurrent]:
    return [effect for effect in camera.recipe.sensor.effects if isinstance(effect, DarkCurrent)]


def changed(camera: Camera, dark: list[DarkCurrent]) -> Camera:
    """The camera with these in place of its own."""
    sensor = camera.recipe.sensor
    others = [effect for effect in sensor.effects if not isinstance(effect, DarkCurrent)]
    sensor = sensor.model_copy(update={"effects": (*others, *dark)})
    return replace(camera, recipe=camera.recipe.model_copy(update={"sensor": sensor}))


def without(camera: Camera) -> Camera:
    return changed(camera, [])


def without_noise(camera: Camera) -> Camera:
    return changed(camera, [dark.model_copy(update={"noise": False}) for dark in of(camera)])


def levels(facts: Facts) -> list[Level]:
    """From left out to in full."""
    return [
        Level("none", {"simplifications": (Simplification("dark current", without),)}),
        Level("its mean", {"simplifications": (Simplification("noise of the dark", without_noise),)}),
        Level("counted", {}),
    ]


def error(facts: Facts, level: Level) -> Errors:
    """Of n electrons of N: their mean n / N, and their noise, sqrt(n) / N."""
    dark = of(facts.camera)
    mean = sum(each.electrons / each.full_well_electrons for each in dark)
    variance = sum(each.noise * each.electrons / each.full_well_electrons**2 for each in dark)
    return ((variance + (mean**2 if level.label == "none" else 0.0)) ** 0.5,) * 3


def absent(facts: Facts) -> str:
    return "" if of(facts.camera) else "the sensor has no dark current"


def why(facts: Facts) -> str:
    return f"{sum(each.electrons for each in of(facts.camera)):g} electrons of the dark are in each pixel"


EFFECT = Effect("dark current", levels, why, absent, error=error, added="bias", stage="sensor")
