"""Sub-apertures: light from behind an edge fills only one side of the pupil, and is blurred so."""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
from torch import Tensor
from torch.nn import functional

from ..effect import Effect, Level, overall
from ..facts import Facts, photo_changes, rms

FEWER = 3
SEEN = 0.85
SEEN_BY_FEWER = 0.75
"""Of what sub-apertures change, what a coarse photo through all of them shows, and one through 3 x 3."""
USUALLY_LEFT = 0.1, 0.3
"""Share of the change that 3 x 3 leave out in most scenes, or more, without and with a mask. Where that is
too much, nothing is photographed through all of them."""
LEFT_BY_COARSE = 1.7, 1.2, 0.064
"""And what pixels this many times as wide leave out of the change: the first times what averages over pixels
of another width leave out, times the ratio of the widths to the power of the second; and at least the third
times the root of the width.

They are from whole frames of six shipped scenes and members 902 of families, the others from middles of
shipped scenes, see `python -m docs.studies.sub_apertures`."""


def absent(facts: Facts) -> str:
    if not facts.edges:
        return "there are no depth edges: nothing stops light in one sub-aperture alone"
    if not facts.hidden:
        return "no surface hides another, so nothing is there to be seen past edges"
    if facts.camera.lens.measured:
        return "PSFs are measured: nothing is known of the parts of the pupil"
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
    """Of coarse photos, which show what fewer sub-apertures leave out. What coarse pixels do follows from how
    fine the change is."""
    full = facts.full.sub_apertures
    few = min(FEWER, full)
    (seen,) = photo_changes(facts, [{"sub_apertures": 1}], sub_apertures=few)
    whole, fewer = seen / SEEN_BY_FEWER, USUALLY_LEFT[facts.camera.has_mask]
    insisted = len(levels) >= len(EFFECT.levels(facts))
    if few == full:
        whole = seen / SEEN
    elif insisted or fewer * overall(rms(whole)) <= facts.allowed:
        seen, left_out = photo_changes(facts, [{"sub_apertures": n} for n in (1, few)], sub_apertures=full)
        whole, fewer = seen / SEEN, _size(left_out) / max(_size(seen), 1e-30)
    coarse = facts.coarse
    fine = _finer_than(2, seen.unflatten(1, (coarse.view.height, coarse.view.width)))

    def left(level: Level) -> Tensor:
        across = level.change["sub_apertures"]
        if across == 1:
            return whole
        if across not in (few, full):  # what a user insists on
            return photo_changes(facts, [{"sub_apertures": across}], sub_apertures=full)[0] / SEEN
        side = level.change.get("sub_aperture_pixel", 1)
        return whole * math.hypot(fewer if across < full else 0.0, _left_by(side, fine, 2 * coarse.times))

    return [left(level) for level in levels]


def _left_by(side: int, fine: float, width: int) -> float:
    """What pixels of `side` leave out, if averages over `width` leave out `fine`, as shares."""
    if side == 1:
        return 0.0
    factor, power, least = LEFT_BY_COARSE
    return math.hypot(least * side**0.5, min(1.0, factor * fine * (side / width) ** power))


def _finer_than(width: int, change: Tensor) -> float:
    """What means of squares of pixels, with slopes between them, leave out of a change [channel, y, x], as a
    share of it."""
    rows, columns = (size // width * width for size in change.shape[-2:])
    if not rows or not columns:
        return 1.0
    change = change[None, :, :rows, :columns]
    means = functional.avg_pool2d(change, width)
    between = functional.interpolate(means, scale_factor=width, mode="bilinear")
    return _size(change - between) / max(_size(change), 1e-30)


def _size(change: Tensor) -> float:
    return float(torch.linalg.vector_norm(change))


EFFECT = Effect(
    "sub-apertures",
    levels,
    why,
    absent,
    differences,
    within="hidden surfaces",
    adds_to_parent=True,
    one_pass=True,
)
