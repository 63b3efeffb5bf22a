"""Occlusion: what is in front hides what is behind, in some sub-apertures or in all."""

from __future__ import annotations

from collections.abc import Sequence

from torch import Tensor

from ..effect import Effect, Level
from ..facts import Facts, photographed


def absent(facts: Facts) -> str:
    return "" if facts.edges else "there are no depth edges: nothing covers anything"


def levels(facts: Facts) -> list[Level]:
    return [Level("none", {"occlusion": "none", "hidden_surfaces": False}), Level("front to back", {})]


def why(facts: Facts) -> str:
    return f"{facts.edges} pixels lie on depth edges"


def differences(facts: Facts, levels: Sequence[Level]) -> list[Tensor]:
    """Of coarse photos with the pupil as a whole."""
    return photographed(facts, [level.change for level in levels])


EFFECT = Effect("occlusion", levels, why, absent, differences)
