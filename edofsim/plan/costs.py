"""What a simulation of a photo costs in time and memory, before any of it is done.

Work is counted. Choices weigh it by the reference costs that ship, so that they are the same on every
machine; what this machine takes for it is reported, and decides only for a target of time.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field

from ..capture.fidelity import Fidelity
from .effect import Effect
from .estimate import levels_of
from .facts import Facts
from .rates import SHIPPED, Rates
from .shape import Shape
from .work import Work, work_of

BASE_MIB = 450.0
"""Memory of the process before any photo: Python, torch, the renderer."""
WORTH_ASKING = 0.1
"""An effect is looked at only where leaving it out saves this fraction of the work."""
WORTH_S = 1.0
"""And this many reference seconds: looking at the light of a view takes about as long."""


def nothing(fidelity: Fidelity) -> float:
    """What rendering costs where the view is there."""
    return 0.0


@dataclass(frozen=True)
class Rendering:
    """What it costs to render a view for a fidelity.

    reference: in reference seconds, from counted rays.
    seconds: predicted, of this machine.
    """

    reference: Callable[[Fidelity], float] = nothing
    seconds: Callable[[Fidelity], float] = nothing


@dataclass(frozen=True)
class Costs:
    """facts.

    shape: of the view.
    rates: of this machine.
    rendering: of the view, where it is still to do.
    """

    facts: Facts
    shape: Shape
    rates: Rates
    rendering: Rendering = Rendering()
    _known: dict[Fidelity, Work] = field(default_factory=dict, repr=False, compare=False)

    def reference(self, fidelity: Fidelity) -> float:
        """Counted work at the reference costs, in seconds of the machine that they were measured on."""
        return self.rendering.reference(fidelity) + sum(_weighed(self.work(fidelity), SHIPPED).values())

    def seconds_of(self, fidelity: Fidelity) -> Mapping[str, float]:
        """Predicted seconds of each stage, on this machine."""
        return {"render": self.rendering.seconds(fidelity), **_weighed(self.work(fidelity), self.rates)}

    def seconds(self, fidelity: Fidelity) -> float:
        """Predicted seconds of all stages, on this machine."""
        return sum(self.seconds_of(fidelity).values())

    def memory_mib(self, fidelity: Fidelity) -> float:
        """Predicted peak memory of the process."""
        return BASE_MIB + self.work(fidelity).bytes / 2**20

    def work(self, fidelity: Fidelity) -> Work:
        """Counted work of a simulation."""
        if fidelity not in self._known:
            layers = self.facts.layers_of(fidelity.layers)
            groups, colours = self._counts(fidelity)
            how = (self.shape, self.facts.camera, fidelity, layers, groups, colours)
            step = self.facts.step_of(fidelity)
            self._known[fidelity] = work_of(*how, step, self.facts.step_of_parts(fidelity, step))
        return self._known[fidelity]

    def _counts(self, fidelity: Fidelity) -> tuple[int, int]:
        """Images that are blurred for each depth, and wavelengths that PSFs are computed at."""
        bands, channels = self.facts.view.bands, len(self.facts.response)
        groups, wavelengths = fidelity.band_groups, fidelity.group_wavelengths
        if groups == 0:
            return bands, bands
        return groups * channels, bands if wavelengths == 0 else min(bands, groups * channels * wavelengths)

    def worth_asking(
        self, effects: Sequence[Effect], most_seconds: float | None = None, least_saved: float = WORTH_S
    ) -> Collection[str]:
        """Names of the effects that a choice could save work by; none where there is less than `least_saved`
        reference seconds to save.

        most_seconds: where a time is asked for, seconds of this machine count, and none is looked at where
            everything in full stays within them.
        """
        cost = self.reference if most_seconds is None else self.seconds
        now = cost(self.facts.full)
        if now <= max(most_seconds or 0.0, least_saved):
            return ()
        found: list[str] = []
        least = self.facts.full
        for effect in effects:
            absent, levels = levels_of(self.facts, effect)
            for level in levels[:-1]:
                saved = now - cost(self.facts.full.changed(level.change))
                if level.allowed and saved > WORTH_ASKING * now:
                    found.append(effect.name)
                    least = least.changed(level.change)
                    break
        saved = now - cost(least)
        return () if saved < least_saved else tuple(found)


def _weighed(work: Work, rates: Rates) -> dict[str, float]:
    return {
        stage: sum(rates[stage].get(kind, 0.0) * amount for kind, amount in amounts.items())
        for stage, amounts in work.amounts.items()
    }
