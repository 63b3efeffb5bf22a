"""What a plan predicts, as figures."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

from ..capture.photo import Photo
from .effect import Plan, decibels, overall


def plan_figures(plan: Plan, planning: float | None = None) -> dict[str, float]:
    """What a plan predicts, flat: a dotted name with its unit to a number.

    planning: seconds that making it took, of which the share of what it saves is reported.
    """
    if plan.replayed:
        return {}
    found: dict[str, float] = {"plan.psnr_db": plan.error_db, "plan.memory_mib": plan.memory_mib}
    found["plan.seconds"] = sum(plan.seconds.values())
    found |= {f"plan.seconds.{stage}": value for stage, value in plan.seconds.items()}
    found["plan.seconds_saved"] = plan.saves()
    if planning is not None and plan.saves() > 0:
        found["plan.share_of_saved"] = planning / plan.saves()
    for decision in plan.decisions:
        name = decision.effect.replace(" ", "_")
        found[f"called_for.{name}"] = int(decision.called_for)
        if decision.error is not None:
            found[f"psnr_db.without_{name}"] = decibels(overall(decision.error))
            found[f"plan.seconds.{name}"] = decision.seconds
    return found


def with_predicted(photo: Photo, plan: Plan) -> Photo:
    """The photo of a plan, which also says in `how`, and so in its file, what the plan predicts of it: the
    PSNR against everything in full, and that by what each effect leaves out, in dB."""
    if plan.replayed:
        return photo
    left = {each.effect: decibels(overall(each.left)) for each in plan.decisions if each.left}
    said: Mapping[str, object] = {
        "psnr_db": round(plan.error_db, 2) if math.isfinite(plan.error_db) else None,
        "left_out_db": {name: round(db, 2) for name, db in left.items() if math.isfinite(db)},
    }
    return replace(photo, how=replace(photo.how, predicted=said))
