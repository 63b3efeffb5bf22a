"""The cheapest simulation whose errors stay within a budget, and the most accurate within a time."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from ..capture.fidelity import Fidelity, Simplification
from .estimate import Estimates

Chosen = dict[str, int]
Cost = Callable[[Chosen], float]
"""Of a simulation: counted work by the reference costs, or seconds of this machine for a target of time."""

SAVING_WORTHWHILE = 2e-3
"""An effect is left out only where that saves this fraction of the cost: what costs nothing is simulated."""


def fidelity_of(estimates: Estimates, chosen: Mapping[str, int], full: Fidelity) -> Fidelity:
    """The simulation with these levels; what a left-out effect makes moot is left at the finest, but for
    sub-apertures, which other ways to composite than `hidden` do not know."""
    change: dict[str, object] = {}
    left_out: tuple[Simplification, ...] = ()
    for row in estimates.rows:
        if not estimates.moot(row, chosen):
            new = row.levels[chosen[row.effect.name]].change
            left_out += new.get("simplifications", ())
            change |= new
    if change.get("occlusion", full.occlusion) != "hidden":
        change["sub_apertures"] = 1
    return full.changed(change | ({"simplifications": left_out} if left_out else {}))


def everything(estimates: Estimates, fixed: Mapping[str, int]) -> Chosen:
    """All effects in full but for those that are fixed."""
    return {row.effect.name: fixed.get(row.effect.name, row.full) for row in estimates.rows}


def cheapest(estimates: Estimates, budget: float, cost: Cost, fixed: Mapping[str, int]) -> Chosen:
    """Levels of least cost whose root mean square error stays within the budget.

    From everything in full, the step to another level that saves most for the error it adds is taken,
    again and again; then every single effect is tried one level finer, to see whether that gives the others
    room to save more.
    """
    best = _descended(estimates, everything(estimates, fixed), budget, cost, fixed)
    for row in estimates.rows:
        name = row.effect.name
        level = best[name]
        if name in fixed or level == row.full:
            continue
        held = {**fixed, name: level + 1}
        other = _descended(estimates, everything(estimates, held), budget, cost, held)
        if cost(other) < (1 - SAVING_WORTHWHILE) * cost(best):
            best = other
    return best


def _descended(
    estimates: Estimates, chosen: Chosen, budget: float, cost: Cost, fixed: Mapping[str, int]
) -> Chosen:
    now, error = cost(chosen), estimates.total(chosen)
    while True:
        step, gain = None, 0.0
        for row in estimates.rows:
            name = row.effect.name
            if name in fixed:
                continue
            for level, described in enumerate(row.levels):
                if level == chosen[name] or not described.allowed:
                    continue
                other = {**chosen, name: level}
                after = estimates.total(other)
                if after > budget:
                    continue
                saved = now - cost(other)
                if saved <= SAVING_WORTHWHILE * now:
                    continue
                added = max(after**2 - error**2, 1e-6 * budget**2)
                if saved / added > gain:
                    step, gain = other, saved / added
        if step is None:
            return chosen
        chosen, now, error = step, cost(step), estimates.total(step)


def within(
    estimates: Estimates, limit: float, seconds: Cost, fixed: Mapping[str, int]
) -> tuple[Chosen, bool]:
    """The most accurate levels that take no more than `limit` seconds, and whether there are any.

    Where there are none: the fastest.
    """
    whole = everything(estimates, fixed)
    if seconds(whole) <= limit:
        return whole, True
    low, high = 0.0, 100.0  # decibels: at 0 anything goes
    best = cheapest(estimates, 1.0, seconds, fixed)
    if seconds(best) > limit:
        return best, False
    while high - low > 0.5:
        middle = (low + high) / 2
        chosen = cheapest(estimates, 10 ** (-middle / 20), seconds, fixed)
        if seconds(chosen) <= limit:
            best, low = chosen, middle
        else:
            high = middle
    return best, True
