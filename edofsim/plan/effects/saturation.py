"""Saturation: a pixel that is full shows no more."""

from __future__ import annotations

from ..effect import Effect, Errors, Level
from ..facts import Facts, rms


def absent(facts: Facts) -> str:
    if facts.camera.recipe.sensor.saturation:
        return ""
    return "the recipe asks for none" + (
        ", but the converter clips" if facts.camera.recipe.sensor.bits else ""
    )


def levels(facts: Facts) -> list[Level]:
    return [Level("none", {"saturation": False}), Level("at full scale", {})]


def error(facts: Facts, level: Level) -> Errors:
    """What the photo holds beyond black and full scale."""
    photo = facts.blurred
    beyond = photo - photo.clamp(0, 1)
    return rms(beyond / photo.shape[1] ** 0.5) if level.change else (0.0,) * len(photo)


def why(facts: Facts) -> str:
    photo = facts.blurred
    share = float((photo > 1).any(0).double().mean())
    return f"{share:.2%} of the pixels see more light than they hold"


EFFECT = Effect("saturation", levels, why, absent, error=error, added="noise", stage="sensor")
