"""Sub-apertures: light from behind an edge fills only one side of the pupil, and is blurred so."""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
from torch import Tensor

from ...capture.fidelity import FULL_SUB_APERTURES
from ..effect import Effect, Level
from ..facts import Facts, photographed

FEWER = 4
LEFT_BY_FEWER = 0.22
"""Of what `FULL_SUB_APERTURES` change, what 4 x 4 leave out: 0.05 to 0.45 on the middles of `clutter`,
`foliage`, `stilllife`, `hallway` and `bench` through three masks (`python -m benchmarks.sub_apertures` with
their names)."""
LEFT_BY_COARSE = {4: 0.35, 2: 0.17}
"""And what pixels so many times as wide do, with the fewer layers and wavelengths that come with them: 0.07
to 0.39 and 0.05 to 0.24 there. Where blurs are few pixels wide it can be several times as much."""


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
    some = [(FEWER, 4), (FEWER, 2), (full, 2)] if full > FEWER else [(full, 4), (full, 2)]
    coarse = [
        Level(f"{n} x {n}, in pixels of {side}", {"sub_apertures": n, "sub_aperture_pixel": side})
        for n, side in some
    ]
    whole = Level("the whole pupil", {"sub_apertures": 1})
    return [whole, *coarse, Level(f"{full} x {full}", {"sub_aperture_pixel": 1})]


def why(facts: Facts) -> str:
    return f"{facts.edges} pixels lie on edges past which what is behind fills a part of the pupil"


def differences(facts: Facts, levels: Sequence[Level]) -> list[Tensor]:
    """Of coarse photos. What is left by coarse pixels is a share of what the whole pupil leaves, and what is
    left by `FEWER` sub-apertures too, unless facts are to be looked at closely."""
    full = facts.full.sub_apertures
    most = min(FEWER, full)
    if facts.closely and most < full:
        whole, by_fewer = photographed(facts, [{"sub_apertures": n} for n in (1, most)], sub_apertures=full)
    else:
        (seen,) = photographed(facts, [{"sub_apertures": 1}], sub_apertures=most)
        missed = LEFT_BY_FEWER * (full - most) / (FULL_SUB_APERTURES - FEWER)
        whole = seen / (1 - missed)
        by_fewer = whole * missed

    def left(level: Level) -> Tensor:
        across = level.change["sub_apertures"]
        if across == 1:
            return whole
        if across not in (most, full):  # what a user insists on
            return photographed(facts, [{"sub_apertures": across}], sub_apertures=most)[0]
        coarse = LEFT_BY_COARSE.get(level.change.get("sub_aperture_pixel", 1), 0.0)
        if across == full:
            return whole * coarse
        return by_fewer * math.hypot(1.0, coarse * _size(whole) / max(_size(by_fewer), 1e-30))

    return [left(level) for level in levels]


def _size(change: Tensor) -> float:
    return float(torch.linalg.vector_norm(change))


EFFECT = Effect("sub-apertures", levels, why, absent, differences, within="hidden surfaces", beside=True)
