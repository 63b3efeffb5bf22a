"""What a simulation of a photo costs in time and memory, before any of it is done."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field

from ..capture.fidelity import Fidelity
from .effect import Effect
from .estimate import levels_of
from .facts import Facts
from .rates import Rates
from .work import Shape, Work, work_of

BASE_MIB = 450.0
"""Memory of the process before any photo: Python, torch, the renderer."""
WORTH_ASKING = 0.1
"""An effect is looked at only where leaving it out saves this fraction of the time."""
WORTH_S = 1.0
"""And this many seconds: looking at the light of a view takes about as long."""
WORTH_RESTORING_S = 5.0
"""This many where parts of it are restored, too."""


@dataclass(frozen=True)
class Costs:
    """facts; shape: of the view; rates: of this machine; render_seconds: predicted, of a simulation."""

    facts: Facts
    shape: Shape
    rates: Rates
    render_seconds: Callable[[Fidelity], float] = lambda fidelity: 0.0
    _known: dict[Fidelity, Mapping[str, float]] = field(default_factory=dict, repr=False, compare=False)

    def seconds_of(self, fidelity: Fidelity) -> Mapping[str, float]:
        """Predicted seconds of each stage."""
        if fidelity not in self._known:
            stages = {
                stage: sum(rate * amount for rate, amount in zip(self.rates[stage], amounts, strict=True))
                for stage, amounts in self._work(fidelity).amounts.items()
            }
            self._known[fidelity] = {"render": self.render_seconds(fidelity), **stages}
        return self._known[fidelity]

    def memory_mib(self, fidelity: Fidelity) -> float:
        """Predicted peak memory of the process."""
        return BASE_MIB + self._work(fidelity).bytes / 2**20

    def _work(self, fidelity: Fidelity) -> Work:
        layers = self.facts.layers_of(fidelity.layers)
        groups, colours = self._counts(fidelity)
        return work_of(self.shape, self.facts.camera, fidelity, layers, groups, colours)

    def _counts(self, fidelity: Fidelity) -> tuple[int, int]:
        """Images that are blurred for each depth, and wavelengths that PSFs are computed at."""
        bands, channels = self.facts.view.bands, len(self.facts.response)
        groups, wavelengths = fidelity.band_groups, fidelity.group_wavelengths
        if groups == 0:
            return bands, bands
        return groups * channels, bands if wavelengths == 0 else min(bands, groups * channels * wavelengths)

    def worth_asking(
        self, effects: Sequence[Effect], most_seconds: float, least_saved: float = WORTH_S
    ) -> Collection[str]:
        """Names of the effects that a choice could save time by; none where there is less than `least_saved`
        seconds to save, or where everything in full stays within `most_seconds`."""
        now = sum(self.seconds_of(self.facts.full).values())
        if now <= max(most_seconds, least_saved):
            return ()
        found: list[str] = []
        least = self.facts.full
        for effect in effects:
            absent, levels = levels_of(self.facts, effect)
            for level in levels[:-1]:
                saved = now - sum(self.seconds_of(self.facts.full.changed(level.change)).values())
                if level.allowed and saved > WORTH_ASKING * now:
                    found.append(effect.name)
                    least = least.changed(level.change)
                    break
        saved = now - sum(self.seconds_of(least).values())
        return () if saved < least_saved else tuple(found)
