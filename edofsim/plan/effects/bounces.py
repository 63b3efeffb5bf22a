"""Interreflection: light that comes over several surfaces."""

from __future__ import annotations

from ..effect import Effect, Errors, Level
from ..facts import Facts


def absent(facts: Facts) -> str:
    if facts.recipe is None or facts.recipe.source is not None:
        return "the light of this view is not rendered here"
    return "the recipe asks for direct light alone" if facts.scene.render.max_depth <= 2 else ""


def levels(facts: Facts) -> list[Level]:
    most = facts.scene.render.max_depth
    few = [Level(_label(n), {"bounces": n}) for n in sorted(facts.shorter) if n < most]
    return [*few, Level(_label(most), {})]


def _label(length: int) -> str:
    return "direct light" if length == 2 else f"{length - 1} bounces"


def error(facts: Facts, level: Level) -> Errors:
    return facts.shorter[level.change["bounces"]] if level.change else (0.0,) * len(facts.response)


def why(facts: Facts) -> str:
    return f"the recipe follows paths over {facts.scene.render.max_depth - 1} surfaces"


EFFECT = Effect(
    "interreflection",
    levels,
    why,
    absent,
    error=error,
    added="bias",
    stage="render",
    cuts={"bounces": 2},
)
