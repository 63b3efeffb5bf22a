"""Fabrication error: the mask as it is made, not as it was designed."""

from __future__ import annotations

from ..effect import Effect, Level
from ..facts import Facts


def absent(facts: Facts) -> str:
    return (
        "the recipe says nothing of how the mask is made" if facts.camera.recipe.fabrication is None else ""
    )


def levels(facts: Facts) -> list[Level]:
    return [Level("as designed", {"fabrication": False}), Level("as made", {})]


def why(facts: Facts) -> str:
    made = facts.camera.recipe.fabrication
    if made is None:
        return absent(facts)
    return f"height errors of {made.height_noise_nm:g} nm scatter light; {made.levels or 'no'} grey levels"


EFFECT = Effect(
    "fabrication error",
    levels,
    why,
    absent,
    stage="psf",
)
