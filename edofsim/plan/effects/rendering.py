"""What of rendering may be left out: long paths, the dispersion of the scene's glass, samples."""

from __future__ import annotations

from collections.abc import Sequence

from ...capture.fidelity import disperses
from ..effect import Effect, Errors, Level
from ..facts import Facts

FEWEST = 4
"""Samples a pixel."""
ONE_INDEX = {"scene_dispersion": False}


def _not_here(facts: Facts) -> str:
    rendered = facts.recipe is not None and facts.recipe.source is None
    return "" if rendered else "the light of this view is not rendered here"


def _direct(facts: Facts) -> str:
    if found := _not_here(facts):
        return found
    return "the recipe asks for direct light alone" if facts.scene.render.max_depth <= 2 else ""


def _lengths(facts: Facts) -> Sequence[Level]:
    most = facts.scene.render.max_depth
    said = {n: "direct light" if n == 2 else f"{n - 1} bounces" for n in (*sorted(facts.bounce_errors), most)}
    return [*(Level(label, {"bounces": n}) for n, label in said.items() if n < most), Level(said[most], {})]


INTERREFLECTION = Effect(
    "interreflection",
    _lengths,
    lambda facts: f"the recipe follows paths over {facts.scene.render.max_depth - 1} surfaces",
    _direct,
    error=lambda facts, level: facts.bounce_errors[level.change["bounces"]],
    added="bias",
    stage="render",
    cuts={"bounces": 2},
)


def _no_glass(facts: Facts) -> str:
    if found := _not_here(facts):
        return found
    return "" if disperses(facts.scene) else "no glass in the scene disperses light"


DISPERSION = Effect(
    "dispersion of scene glass",
    lambda facts: [Level("one index for all bands", ONE_INDEX), Level("behind the glass alone", {})],
    lambda facts: f"glass bends each wavelength differently ({', '.join(disperses(facts.scene))})",
    _no_glass,
    error=lambda facts, level: facts.glass_error or (0.0,) * len(facts.response),
    added="bias",
    stage="render",
    cuts=ONE_INDEX,
)


def _samples(facts: Facts) -> int:
    return facts.recipe.render.samples if facts.recipe else int(facts.view.metadata.get("samples", 1))


def _fewer_samples(facts: Facts) -> Sequence[Level]:
    most = _samples(facts)
    few = [Level(f"{n} samples", {"samples": n}) for n in (FEWEST, 8, 16, 32, 64, 128) if n < most]
    return [*few, Level(f"{most} samples", {})]


def _noise(facts: Facts, level: Level) -> Errors:
    """Variance falls with the number of samples; those of the full rendering are among its own."""
    more = max(0.0, _samples(facts) / level.change["samples"] - 1)
    return tuple(value * more**0.5 for value in facts.monte_carlo_noise)


SAMPLES = Effect(
    "render samples",
    _fewer_samples,
    lambda facts: f"one pixel's noise is {facts.view.noise:.1%} of the mean, and the blur averages it",
    lambda facts: "" if facts.view.noise > 0 else "this view was not rendered by sampling",
    error=_noise,
    added="noise",
    stage="render",
    cuts={"samples": FEWEST},
)
