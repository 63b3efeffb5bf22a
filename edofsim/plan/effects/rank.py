"""Rank: PSFs of many depths and bands as combinations of few images."""

from __future__ import annotations

from ..effect import Effect, Errors, Level
from ..facts import Facts

SHARE = 0.45
"""Of the tolerance: photos of the shipped scenes err by 0.33 to 0.8 of it."""


def absent(facts: Facts) -> str:
    return "there is one depth: nothing to combine" if facts.depth_count == 1 else ""


def levels(facts: Facts) -> list[Level]:
    # gathered bands and few layers leave so few convolutions that finding the combinations costs more
    low = Level("rank of 50 dB", {"method": "low_rank", "rank_db": 50.0}, allowed=False)
    return [low, Level("every PSF", {})]


def error(facts: Facts, level: Level) -> Errors:
    """What the factorisation is asked for bounds the worst depth and a rank is a whole number: the photo as a
    whole errs by less."""
    tolerance = 10 ** (-level.change["rank_db"] / 20) if "rank_db" in level.change else 0.0
    return (SHARE * tolerance,) * len(facts.response)


def why(facts: Facts) -> str:
    return "with bands gathered, each PSF is convolved on its own in less time than a factorisation takes"


EFFECT = Effect("rank", levels, why, absent, error=error)
