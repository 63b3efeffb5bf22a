"""Sub-apertures: light from behind an edge fills only one side of the pupil, and is blurred so."""

from __future__ import annotations

from collections.abc import Sequence

from torch import Tensor

from ..effect import Effect, Level
from ..facts import Facts, photographed

FEWER = 4
LEFT_BY_FEWER = 0.25
"""Of what sub-apertures change, what 4 x 4 leave out."""


def absent(facts: Facts) -> str:
    if not facts.edges:
        return "there are no depth edges: nothing stops light in one sub-aperture alone"
    if not facts.hidden:
        return "what edges hide is not known, so nothing is there to be seen past them"
    if facts.full.sub_apertures == 1:
        return "depths differ so little that diffraction hides what sub-apertures would tell"
    return ""


def levels(facts: Facts) -> list[Level]:
    full = facts.full.sub_apertures
    some = [FEWER] if full > FEWER else []
    fewer = [Level(_label(across), {"sub_apertures": across}) for across in (1, *some)]
    return [*fewer, Level(_label(full), {})]


def _label(across: int) -> str:
    return "the whole pupil" if across == 1 else f"{across} x {across}"


def why(facts: Facts) -> str:
    return f"{facts.edges} pixels lie on edges past which what is behind fills a part of the pupil"


def differences(facts: Facts, levels: Sequence[Level]) -> list[Tensor]:
    """Of coarse photos, against `FEWER`: more change little, and by a share that hardly varies."""
    most = min(FEWER, facts.full.sub_apertures)
    found = photographed(facts, [level.change for level in levels], sub_apertures=most)
    one = photographed(facts, [{"sub_apertures": 1}], sub_apertures=most)[0]
    return [
        one * LEFT_BY_FEWER if level.change["sub_apertures"] == most < facts.full.sub_apertures else each
        for level, each in zip(levels, found, strict=True)
    ]


EFFECT = Effect("sub-apertures", levels, why, absent, differences, within="hidden surfaces", beside=True)
