"""Broken plans."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import replace

from hard_cases import convergence

from edofsim.plan import Plan

from .mutant import Mutant, after, swapped, together


def _every_plan(**change: object) -> Callable[[], AbstractContextManager[object]]:
    """The plans of all photos, with another fidelity."""

    def changed(plan: Plan) -> Plan:
        return replace(plan, fidelity=plan.fidelity.changed(change))

    return lambda: together(*(after(convergence, name, changed) for name in ("plan_photo", "plan_alone")))


def _the_other(plan: Plan, *given: object, **options: object) -> Plan:
    return plan


MUTANTS: tuple[Mutant, ...] = (
    Mutant(
        "the mask's plan for the lens alone",
        "which has too few depth layers for it",
        ("plan",),
        lambda: swapped(convergence, "plan_alone", _the_other),
    ),
    Mutant("nine depth layers", "whatever the camera", ("plan",), _every_plan(layers=9)),
    Mutant("plans without occlusion", "all light is added", ("plan",), _every_plan(occlusion="none")),
)
