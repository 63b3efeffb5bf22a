"""Hidden surfaces: a blurred edge uncovers light from behind it, which the pinhole cannot see."""

from __future__ import annotations

from collections.abc import Sequence

from torch import Tensor

from ..effect import Effect, Level
from ..facts import Facts, photographed


def absent(facts: Facts) -> str:
    if not facts.edges:
        return "there are no depth edges: nothing is hidden"
    if not facts.hidden:
        return "no surface hides another, as far as the blur can tell"
    return ""


def levels(facts: Facts) -> list[Level]:
    # layers that are filled from beside lie at the depth nodes: it would take many of them
    beside = {"occlusion": "normalised", "hidden_surfaces": False}
    return [
        Level("filled from beside", beside, allowed=False),
        Level(f"{facts.hidden} fragments{' guessed' * bool(facts.guessed)}", {}),
    ]


def why(facts: Facts) -> str:
    if facts.guessed:
        return f"what edges hide is not known; {facts.view.metadata['hidden']}"
    return f"{facts.hidden} fragments behind edges are known, which a blur uncovers"


def differences(facts: Facts, levels: Sequence[Level]) -> list[Tensor]:
    """Of coarse photos with the pupil as a whole: hidden fragments are taken out of the view."""
    return photographed(facts, [{"occlusion": "normalised"} for _ in levels], layers=75)


EFFECT = Effect(
    "hidden surfaces",
    levels,
    why,
    absent,
    differences,
    within="occlusion",
    cuts={"hidden_surfaces": False},
)
