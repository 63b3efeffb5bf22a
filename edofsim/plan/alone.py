"""The photo through the lens alone, that others are compared with: planned as accurately, by itself."""

from __future__ import annotations

import math

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
    """The plan of a photo through the lens alone, as accurate as that of the photo through the mask. A mask
    evens the blur: the bare lens may ask for ten times as many depth layers.

    plan, facts: of the photo through the mask, which `overrule` and `target` (see `plan_photo`) asked for;
    alone: that camera without its mask. Raises InputError as `plan_photo`.
    """
    how = {"facts": through_mask_like(facts, alone), "progress": progress}
    return plan_photo(facts.view, alone, overrule, as_accurate(plan, target), every_effect=False, **how)


def as_accurate(plan: Plan, target: Target | None) -> Target:
    """What a photo to compare with is planned for: the error that the plan of the first one promises.

    target: that of the first one. An accuracy holds for both; a time, and the score of a restored image, are
    of the first alone, and the other is planned for the accuracy that they came to.
    """
    if target is None or target.kind in ("noise", "db", "full"):
        return target or Target()
    promised = plan.error_db if target.kind == "time" else plan.asked_db
    return Target("full") if promised is None or math.isinf(promised) else Target("db", db=promised)
