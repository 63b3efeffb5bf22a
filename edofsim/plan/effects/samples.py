"""Samples a pixel: the noise that rendering leaves in the photo."""

from __future__ import annotations

from ..effect import Effect, Errors, Level
from ..facts import Facts

FEWEST = 4


def absent(facts: Facts) -> str:
    return "" if facts.view.noise > 0 else "this view was not rendered by sampling"


def levels(facts: Facts) -> list[Level]:
    most = facts.recipe.render.samples if facts.recipe else int(facts.view.metadata.get("samples", 1))
    few = [Level(f"{n} samples", {"samples": n}) for n in (FEWEST, 8, 16, 32, 64, 128) if n < most]
    return [*few, Level(f"{most} samples", {})]


def error(facts: Facts, level: Level) -> Errors:
    """Variance falls with the number of samples; those of the full rendering are among its own."""
    if not level.change:
        return (0.0,) * len(facts.monte_carlo_noise)
    most = facts.recipe.render.samples if facts.recipe else int(facts.view.metadata["samples"])
    more = max(0.0, most / level.change["samples"] - 1)
    return tuple(value * more**0.5 for value in facts.monte_carlo_noise)


def why(facts: Facts) -> str:
    return f"one pixel's noise is {facts.view.noise:.1%} of the mean, and the blur averages it"


EFFECT = Effect(
    "render samples",
    levels,
    why,
    absent,
    error=error,
    added="noise",
    stage="render",
    cuts={"samples": FEWEST},
)
