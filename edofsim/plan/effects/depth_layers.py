"""Depth layers: the blur changes with depth; PSFs between the layers are interpolated."""

from __future__ import annotations

from ..effect import Effect, Level
from ..facts import Facts, metres
from ..sample import FINEST_LAYERS

LAYERS = (1, 2, 3, 4, 5, 7, 9, 13, 17, 25, 33)


def absent(facts: Facts) -> str:
    if facts.depth_count == 1:
        return f"everything lies at {metres(facts.sample.ends[1])}: one convolution a band is exact"
    return ""


def levels(facts: Facts) -> list[Level]:
    most = facts.depth_count or FINEST_LAYERS
    few = [Level(f"{n} layer{'s'[: n > 1]}", {"layers": n}) for n in LAYERS if n < most]
    full = f"{facts.depth_count} layers" if facts.depth_count else "all layers"
    return [*few, Level(full, {"layers": None})]


def why(facts: Facts) -> str:
    far, near = facts.sample.ends
    return f"depths from {metres(near)} to {metres(far)} change the blur by {facts.blur_spread:.1f} pixels"


EFFECT = Effect(
    "depth layers",
    levels,
    why,
    absent,
    sample={"groups": 1, "colours": 1, "occlusion": "none", "layers": None},
)
