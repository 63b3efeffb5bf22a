"""Occlusion: what is in front hides what is behind, in some sub-apertures or in all."""

from __future__ import annotations

from ..effect import Effect, Level
from ..facts import Facts


def absent(facts: Facts) -> str:
    return "" if facts.edges else "there are no depth edges: nothing covers anything"


def levels(facts: Facts) -> list[Level]:
    return [Level("none", {"occlusion": "none", "hidden_surfaces": False}), Level("front to back", {})]


def why(facts: Facts) -> str:
    return f"{facts.edges} pixels lie on depth edges"


# The whole window: what shines far beyond an edge, as lamps do, is seen to be blocked only by that
EFFECT = Effect(
    "occlusion",
    levels,
    why,
    absent,
    sample={"band_groups": 1, "group_wavelengths": 2, "layers": 9, "window_px": None},
)
