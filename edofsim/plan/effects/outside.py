"""Light from outside the frame: the blur carries it in from a margin."""

from __future__ import annotations

from collections.abc import Sequence

from torch import Tensor

from ..effect import Effect, Level
from ..facts import Facts, photo_changes


def absent(facts: Facts) -> str:
    return "" if facts.view.margin else "the view holds nothing beyond its frame"


def levels(facts: Facts) -> list[Level]:
    window = facts.camera.recipe.psf.window_px
    reach = min(facts.view.margin, window // 2)
    least = (window - min(facts.view.height, facts.view.width)) / 2  # no PSF is wider than its image
    few = [
        Level(f"{n} px" if n else "the border's own", {"margin_px": n})
        for n in (0, 16, 32)
        if least <= n < reach
    ]
    return [*few, Level(f"{reach} px", {})]


def why(facts: Facts) -> str:
    reach = facts.camera.recipe.psf.window_px // 2
    return f"a PSF reaches {reach} pixels; the view holds {facts.view.margin} beyond the frame"


def differences(facts: Facts, levels: Sequence[Level]) -> list[Tensor]:
    """Of coarse photos without occlusion."""
    return photo_changes(facts, [level.change for level in levels], occlusion="none", layers=4)


EFFECT = Effect(
    "light from outside",
    levels,
    why,
    absent,
    differences,
    stage="render",
)
