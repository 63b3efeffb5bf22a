"""Which effects a photo calls for: estimated on a sample, chosen by time and error, and said in words."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from ..capture.fidelity import Fidelity
from ..core.progress import Progress
from ..core.threads import one_thread_an_operation
from ..optics import Camera
from ..render.view import View
from .choose import Chosen, Cost, cheapest, everything, fidelity_of, within
from .costs import Costs, Rendering
from .effect import Decision, Effect, Level, Plan, Values, decibels, overall
from .effects import all_effects
from .estimate import Estimate, Estimates
from .facts import Facts, facts_of, through_mask_like
from .overrule import checked_overrule
from .rates import rates
from .remember import remembered
from .target import Target, as_accurate

SAFETY_DB = 1.0
"""The budget is smaller than what is asked for by this: estimates are of a sample."""
TERMS_NEARER_DB = 5.0
"""Than is asked for: what kernels that stand for the PSFs of places may change adds next to nothing."""
NODES_NEARER_DB = 10.0
"""And where the nodes of depths follow from the same figure: theirs adds up with it."""
OCCLUSION_DB = 1.5
"""And by this where occlusion is simulated: it is seen in few large pixels, and what passes it in slabs."""


@dataclass(frozen=True)
class Planner:
    """Everything that is known before a choice: facts, estimates, and what simulations cost.

    One planner answers many targets; estimates are made once.
    """

    facts: Facts
    costs: Costs
    estimates: Estimates
    disk_mib: float = 0.0

    def seconds_of(self, fidelity: Fidelity) -> Mapping[str, float]:
        """Predicted seconds of each stage."""
        return self.costs.seconds_of(fidelity)

    def plan(self, target: Target | None = None, fixed: Mapping[str, int] | None = None) -> Plan:
        """Choose for a target.

        fixed: levels of effects that the user insists on.
        """
        target, fixed = target or Target(), dict(fixed or {})

        reference, seconds = (self._of_levels(cost) for cost in (self.costs.reference, self.costs.seconds))

        note, asked = "", target.asked_db(self.facts)
        if target.kind == "full":
            chosen = everything(self.estimates, fixed)
        elif target.kind == "time":
            chosen, possible = within(self.estimates, target.left, seconds, fixed)
            if not possible:
                gone = f", {target.spent:.2g} s are spent," if target.spent else ""
                note = (
                    f"{target.seconds:g} s cannot be had: the fastest simulation of this scene takes "
                    f"{seconds(chosen):.2g} s{gone} and this is it"
                )
        else:
            budget = allowed_error(target, self.facts)
            chosen = cheapest(self.estimates, budget, reference, self._kept(fixed))
            note = self._floor(asked) if target.kind == "db" else ""
            note = note or self._insisted(asked, chosen, fixed)
        return self._plan(chosen, fixed, target, asked, note, seconds)

    def _of_levels(self, cost: Callable[[Fidelity], float]) -> Cost:
        known: dict[tuple[int, ...], float] = {}

        def of(chosen: Chosen) -> float:
            levels = tuple(chosen.values())
            if levels not in known:
                known[levels] = cost(fidelity_of(self.estimates, chosen, self.facts.full))
            return known[levels]

        return of

    def _kept(self, fixed: Mapping[str, int]) -> dict[str, int]:
        """What an accuracy does not trade: the samples that the recipe asks for also make the all-in-focus
        image, which photos are scored against."""
        rows = self.estimates.by_name
        kept = {"render samples": rows["render samples"].full} if "render samples" in rows else {}
        return {**kept, **fixed}

    def _floor(self, asked: float) -> str:
        noise = overall(self.facts.monte_carlo_noise)
        if decibels(noise) >= asked:
            return ""
        more = 10 ** ((asked - decibels(noise)) / 10)
        return (
            f"{asked:.1f} dB cannot be had from this rendering: its own noise leaves {decibels(noise):.1f} "
            f"dB in the photo, whatever is simulated; it takes {more:.1f} times as many samples"
        )

    def _insisted(self, asked: float, chosen: Chosen, fixed: Mapping[str, int]) -> str:
        best = decibels(self.estimates.total(chosen))
        rows = self.estimates.by_name
        held = [name for name, level in fixed.items() if level != rows[name].full]
        if best >= asked or not held:
            return ""
        return (
            f"{asked:.1f} dB cannot be had with {', '.join(held)} as you ask for: {best:.1f} dB is predicted "
            "with everything else in full, and this is it"
        )

    def _plan(
        self,
        chosen: Chosen,
        fixed: Mapping[str, int],
        target: Target,
        asked: float,
        note: str,
        seconds: Cost,
    ) -> Plan:
        fidelity = fidelity_of(self.estimates, chosen, self.facts.full)
        if fidelity.field_step_px and math.isfinite(asked):
            # places are chosen: what is left of it is how well kernels make up their PSFs
            nearer = TERMS_NEARER_DB if fidelity.layers is not None else NODES_NEARER_DB
            fidelity = fidelity.changed({"layers_db": min(fidelity.layers_db, asked + nearer)})
        now = seconds(chosen)
        decisions = []
        for row in self.estimates.rows:
            name = row.effect.name
            level = chosen[name]
            without, with_it = {**chosen, name: 0}, {**chosen, name: level or row.full}
            costs = 0.0 if row.full == 0 else max(0.0, seconds(with_it) - seconds(without))
            called = _called_for(row, asked, level)
            decisions.append(
                Decision(
                    effect=name,
                    called_for=called,
                    chosen="" if row.absent and row.full == 0 else row.levels[level].label,
                    why=_sentence(row, self.facts, level, asked, costs, self.estimates.moot(row, chosen)),
                    overruled=name in fixed,
                    error=row.errors[0] if row.full else None,
                    left=row.errors[level] if not self.estimates.moot(row, chosen) else row.errors[row.full],
                    seconds=costs,
                    stage=row.effect.stage,
                )
            )
        return Plan(
            tuple(decisions),
            fidelity,
            error_db=decibels(self.estimates.total(chosen)),
            asked_db=None if target.kind == "time" else asked,
            seconds=self.seconds_of(fidelity) if now else {},
            memory_mib=self.costs.memory_mib(fidelity),
            disk_mib=self.disk_mib,
            target=target.sentence(self.facts),
            note=note,
            full_seconds=sum(self.seconds_of(self.facts.full).values()),
        )


def allowed_error(target: Target, facts: Facts) -> float:
    """Root mean square error that a plan for a target stays within by its estimates; infinite where the
    target is no error of the photo."""
    if target.kind not in ("noise", "db"):
        return math.inf
    safety = SAFETY_DB + (OCCLUSION_DB if facts.full.occlusion != "none" else 0.0)
    return 10 ** (-(target.asked_db(facts) + safety) / 20)


@one_thread_an_operation()
def planner_of(
    view: View,
    camera: Camera,
    *,
    effects: Sequence[Effect] | None = None,
    more: Mapping[str, Level] | None = None,
    facts: Facts | None = None,
    rendering: Rendering | None = None,
    disk_mib: float = 0.0,
    progress: Progress | None = None,
) -> Planner:
    """Look at a view, or at the facts given, and estimate every effect, or those of `effects`.

    more: levels the user insists on.
    rendering: what the view costs, where it is still to render.
    disk_mib: of the view.
    """
    facts = facts or facts_of(view, camera)
    costs = Costs(facts, facts.shape, rates(), rendering or Rendering())
    found = remembered(facts, effects or all_effects(), more, progress=progress)
    return Planner(facts, costs, found, disk_mib)


@one_thread_an_operation()
def plan_photo(
    view: View,
    camera: Camera,
    overrule: Values | None = None,
    target: Target | None = None,
    *,
    every_effect: bool = True,
    facts: Facts | None = None,
    rendering: Rendering | None = None,
    disk_mib: float = 0.0,
    progress: Progress | None = None,
) -> Plan:
    """Decide on the effects of a photo.

    overrule: what the user insists on: `layers`, `occlusion`, `sub_apertures`, `without` and `with_` (names
        of effects); None values are left to the plan.
    target: None for the default.
    every_effect: False looks only at effects that the choice can save work by, and at levels that it can
        take; other effects are simulated without asking what they do.

    Raises InputError for an effect that is not known.
    """
    given, target = checked_overrule(overrule), target or Target()
    more = _levels_of(given)
    facts = facts or facts_of(view, camera)
    allowed = math.inf if every_effect else allowed_error(target, facts)
    facts = replace(facts, allowed=allowed)
    effects = all_effects()
    costs = Costs(facts, facts.shape, rates(), rendering or Rendering())
    asked = None
    if not every_effect:
        asked = {*more, *given.get("without", ())}
        if target.kind != "full":
            asked |= set(costs.worth_asking(effects, target.left if target.kind == "time" else None))
    found = remembered(facts, effects, more, asked, progress)
    planner = Planner(facts, costs, found, disk_mib)
    return planner.plan(target, fixed_levels(found, given, more))


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

    plan, facts: of the photo through the mask, which `overrule` and `target` (see `plan_photo`) asked for.
    alone: that camera without its mask.

    Raises InputError as `plan_photo`.
    """
    how = {"facts": through_mask_like(facts, alone), "progress": progress}
    return plan_photo(facts.view, alone, overrule, as_accurate(plan, target), every_effect=False, **how)


def _levels_of(insisted: Values) -> dict[str, Level]:
    """Levels for the settings of a photo that a user gives by value."""
    more = {}
    if "layers" in insisted:
        count = insisted["layers"]
        more["depth layers"] = Level(f"{count} layer{'s'[: count > 1]}", {"layers": count})
    across = insisted.get("sub_apertures")
    if "occlusion" in insisted or (across or 1) != 1:
        way = insisted.get("occlusion", "hidden")
        more["occlusion"] = Level(way, {"occlusion": way})
    if across is not None:
        said = "the whole pupil" if across == 1 else f"{across} x {across}"
        more["sub-apertures"] = Level(said, {"sub_apertures": across})
    return more


def fixed_levels(estimates: Estimates, insisted: Values, more: Mapping[str, Level]) -> dict[str, int]:
    """The level of each effect that the user insists on."""
    rows = estimates.by_name
    fixed = {name: rows[name].levels.index(level) for name, level in more.items()}
    for option, full in (("without", False), ("with_", True)):
        for name in insisted.get(option) or ():
            fixed[name] = rows[name].full if full else 0
    way = insisted.get("occlusion")
    if more.get("occlusion") and "hidden surfaces" in rows:
        fixed["hidden surfaces"] = rows["hidden surfaces"].full
    if way not in (None, "hidden") and "sub-apertures" in rows:
        fixed["sub-apertures"] = 0  # no other way knows them
    return fixed


def _called_for(row: Estimate, asked: float, level: int) -> bool:
    """Whether leaving it out would cost more than was asked for; for a time: whether it is simulated."""
    if row.full == 0:
        return not row.absent
    worst = decibels(overall(row.errors[0]))
    return worst < asked if asked != float("inf") else worst < 100 and level > 0


def _sentence(row: Estimate, facts: Facts, level: int, asked: float, costs: float, moot: bool) -> str:
    if row.absent:
        return row.absent
    why = row.effect.why(facts)
    if not row.asked:
        return f"{why}; leaving it out would save next to no time"
    if row.full == 0:  # one level: nothing is left to decide
        return f"{why}; the view is rendered so" if row.effect.stage == "render" else why
    if moot:
        return f"{why}; it does not matter without {row.effect.within}"
    worst = decibels(overall(row.errors[0]))
    if worst < asked:
        return why
    free = "; it costs next to nothing" if level == row.full and costs < 0.01 else ""
    return f"{why}; left out it errs by less than is asked for{free}"
