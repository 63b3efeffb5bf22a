"""Sub-apertures: light from behind an edge fills only one side of the pupil, and is blurred so."""

from __future__ import annotations

from ..effect import Effect, Level
from ..facts import Facts

FEWER = 4


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
    against = {"sub_apertures": full}
    some = [FEWER] if full > FEWER else []
    fewer = [Level(_label(across), {"sub_apertures": across}, sample=against) for across in (1, *some)]
    return [*fewer, Level(_label(full), {})]


def _label(across: int) -> str:
    return "the whole pupil" if across == 1 else f"{across} x {across}"


def why(facts: Facts) -> str:
    return f"{facts.edges} pixels lie on edges past which what is behind fills a part of the pupil"


EFFECT = Effect(
    "sub-apertures",
    levels,
    why,
    absent,
    sample={"band_groups": 1, "group_wavelengths": 1, "layers": 5},
    within="hidden surfaces",
    beside=True,
)
