"""The photo through the lens alone, that others are compared with: planned as accurately, by itself."""

from __future__ import annotations

import math
from dataclasses import replace

from ..core.progress import Progress
from ..optics import Camera
from .effect import Plan, Values
from .facts import Facts, through_mask_like
from .photo import plan_photo
from .target import Target


def plan_alone(
    plan: Plan,
    facts: Facts,
    alone: Camera,
    overrule: Values | None = None,
    target: Target | None = None,
    *,
    progress: Progress | None = None,
) -> Plan:
    """The plan of a photo through the lens alone, by itself: a mask evens the blur, and the bare lens may ask
    for ten times as many depth layers.

    plan, facts: of the photo through the mask, which `overrule` and `target` (see `plan_photo`) asked for;
    alone: that camera without its mask. Raises InputError as `plan_photo`.
    """
    how = {"facts": through_mask_like(facts, alone), "progress": progress}
    return plan_photo(facts.view, alone, overrule, as_accurate(plan, target), every_effect=False, **how)


def as_accurate(plan: Plan, target: Target | None) -> Target:
    """What a photo to compare with is planned for. target: that of the first one. An accuracy holds for both,
    but that nothing is restored from the other, so that it need not be `nearer_db`; a time is of the first
    alone, and the other is planned for the accuracy that it came to."""
    if target is None or target.kind != "time":
        return replace(target or Target(), nearer_db=0.0)
    return Target("full") if math.isinf(plan.error_db) else Target("db", db=plan.error_db)
