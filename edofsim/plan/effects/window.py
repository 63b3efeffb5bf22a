"""PSF window: how far light is carried."""

from __future__ import annotations

from ..effect import Effect, Level
from ..facts import Facts

WINDOWS = (16, 32, 48, 64, 96, 128, 192, 256, 384)


def levels(facts: Facts) -> list[Level]:
    most = facts.camera.recipe.psf.window_px
    few = [Level(f"{n} px", {"window_px": n}) for n in WINDOWS if n < most]
    return [*few, Level(f"{most} px", {})]


def why(facts: Facts) -> str:
    return f"the recipe's PSFs reach {facts.camera.recipe.psf.window_px // 2} pixels"


EFFECT = Effect(
    "PSF window",
    levels,
    why,
    stage="psf",
)
