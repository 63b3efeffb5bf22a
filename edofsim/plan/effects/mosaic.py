"""Bayer mosaic: each pixel sees one colour, and none of the other two."""

from __future__ import annotations

from ..effect import Effect, Errors, Level
from ..facts import Facts, rms


def absent(facts: Facts) -> str:
    return "" if facts.camera.recipe.sensor.bayer else "every pixel sees every channel"


def levels(facts: Facts) -> list[Level]:
    return [
        Level("every channel in every pixel", {"mosaic": False}),
        Level(facts.camera.recipe.sensor.bayer or "none", {}),
    ]


def error(facts: Facts, level: Level) -> Errors:
    """The light that the mosaic keeps out: that of three pixels in four, of green in two."""
    photo = facts.blurred
    pattern = facts.camera.recipe.sensor.bayer or "RGB"
    lost = photo.new_tensor([1 - pattern.count(colour) / 4 for colour in "RGB"])
    return rms(photo * (lost[:, None] / photo.shape[1]).sqrt()) if level.change else (0.0,) * len(photo)


def why(facts: Facts) -> str:
    return f"the sensor's pixels are {facts.camera.recipe.sensor.bayer}"


EFFECT = Effect("Bayer mosaic", levels, why, absent, error=error, added="noise", stage="sensor")
