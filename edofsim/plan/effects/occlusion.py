"""Occlusion: what is in front hides what is behind, which a blurred edge uncovers; the pinhole cannot see it.
Both are seen in coarse photos with the pupil as a whole."""

from __future__ import annotations

from ..effect import Effect, Level
from ..facts import Facts, photo_changes


def _none_hidden(facts: Facts) -> str:
    if not facts.edges:
        return "there are no depth edges: nothing is hidden"
    return "" if facts.hidden else "no surface hides another, as far as the blur can tell"


def _behind(facts: Facts) -> str:
    if facts.guessed:
        return f"what edges hide is not known; {facts.view.metadata['hidden']}"
    return f"{facts.hidden} fragments behind edges are known, which a blur uncovers"


OCCLUSION = Effect(
    "occlusion",
    lambda facts: [
        Level("none", {"occlusion": "none", "hidden_surfaces": False}),
        Level("front to back", {}),
    ],
    lambda facts: f"{facts.edges} pixels lie on depth edges",
    lambda facts: "" if facts.edges else "there are no depth edges: nothing covers anything",
    lambda facts, levels: photo_changes(facts, [level.change for level in levels]),
)

# layers that are filled from their surroundings lie at the depth nodes: it would take many of them
FILLED = {"occlusion": "normalised", "hidden_surfaces": False}

HIDDEN = Effect(
    "hidden surfaces",
    lambda facts: [
        Level("filled from around", FILLED, allowed=False),
        Level(f"{facts.hidden} fragments{' guessed' * bool(facts.guessed)}", {}),
    ],
    _behind,
    _none_hidden,
    # hidden fragments are taken out of the view
    lambda facts, levels: photo_changes(facts, [{"occlusion": "normalised"} for _ in levels], layers=75),
    within="occlusion",
    cuts={"hidden_surfaces": False},
)
