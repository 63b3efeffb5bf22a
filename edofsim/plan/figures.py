"""What a plan predicts, as figures."""

from __future__ import annotations

from .effect import Plan, decibels, overall


def plan_figures(plan: Plan, planning: float | None = None) -> dict[str, float]:
    """What a plan predicts, flat: a dotted name with its unit to a number. planning: seconds that making it
    took, of which the share of what it saves is told."""
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
