"""Light from outside the frame: the blur carries it in from a margin."""

from __future__ import annotations

from ..effect import Effect, Level
from ..facts import Facts


def absent(facts: Facts) -> str:
    return "" if facts.view.margin else "the view holds nothing beyond its frame"


def levels(facts: Facts) -> list[Level]:
    reach = min(facts.view.margin, facts.camera.recipe.psf.window_px // 2)
    few = [Level(f"{n} px" if n else "the border's own", {"margin_px": n}) for n in (0, 16, 32) if n < reach]
    return [*few, Level(f"{reach} px", {})]


def why(facts: Facts) -> str:
    reach = facts.camera.recipe.psf.window_px // 2
    return f"a PSF reaches {reach} pixels; the view holds {facts.view.margin} beyond the frame"


EFFECT = Effect(
    "light from outside",
    levels,
    why,
    absent,
    sample={"band_groups": 1, "group_wavelengths": 2, "layers": 4, "window_px": None},
    stage="render",
)
