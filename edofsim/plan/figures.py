"""What a plan predicts, as figures."""

from __future__ import annotations

from .effect import Plan, decibels, overall


def plan_figures(plan: Plan) -> dict[str, float]:
    """What a plan predicts, flat: a dotted name with its unit to a number."""
    found: dict[str, float] = {"plan.psnr_db": plan.error_db, "plan.memory_mib": plan.memory_mib}
    found["plan.seconds"] = sum(plan.seconds.values())
    found |= {f"plan.seconds.{stage}": value for stage, value in plan.seconds.items()}
    if plan.score_shift_db is not None:
        found["plan.score_shift_db"] = plan.score_shift_db
    for decision in plan.decisions:
        name = decision.effect.replace(" ", "_")
        found[f"called_for.{name}"] = int(decision.called_for)
        if decision.error is not None:
            found[f"psnr_db.without_{name}"] = decibels(overall(decision.error))
            found[f"plan.seconds.{name}"] = decision.seconds
    return found
