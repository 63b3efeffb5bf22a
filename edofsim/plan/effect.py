"""What a plan is made of: effects with their levels, and the decision on each."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar, TypeAlias

from torch import Tensor

from ..capture.fidelity import Fidelity
from ..core.notebook import table_html

if TYPE_CHECKING:
    from .facts import Facts

Values: TypeAlias = Mapping[str, Any]  # pyrefly: ignore[explicit-any]
"""Values by name, each with a type of its own: of fields of a `Fidelity`, of options."""
Errors = tuple[float, ...]
"""Root mean square error of each channel, in sensor units: full scale is 1."""


def overall(errors: Errors) -> float:
    """Root mean square over the channels."""
    return (sum(error * error for error in errors) / len(errors)) ** 0.5 if errors else 0.0


def decibels(error: float) -> float:
    """A root mean square error at full scale 1, as PSNR."""
    return -20 * math.log10(error) if error > 0 else math.inf


@dataclass(frozen=True)
class Level:
    """How finely an effect is simulated: what a reader calls it, and the fields of `Fidelity` that it sets.

    allowed: whether a plan may choose it; a level that is there to say what leaving out costs may not.
    """

    label: str
    change: Values
    allowed: bool = True


@dataclass(frozen=True)
class Effect:
    """One effect of light, optics or sensor.

    name: by which `--without` leaves it out.
    levels: from left out to in full, which is no change to the full simulation.
    why: what it comes from, a clause.
    absent: why scene or camera do not have it, a clause; empty where they do.
    differences: what each of some levels changes in the photo, as tensors [channel, n] whose sum of squares
        over n is the mean square over the frame. Where it is not given, PSFs are taken to change (see
        `Spectra.by_psfs`).
    error: of a level that is not full, where it needs no look at the light.
    added: how errors add up with others: `image` (by the correlation of differences), `noise` (independent)
        or `bias` (the worst case: linearly).
    within: an effect without which this one does not matter.
    adds_to_parent: whether that one is measured without this, so that leaving it out makes both errors.
    stage: render, psf, expose or sensor.
    one_pass: one estimate shows what all levels change.
    cuts: fields of `Fidelity` by which a view is rendered without it, where a user insists on that.
    """

    name: str
    levels: Callable[[Facts], Sequence[Level]]
    why: Callable[[Facts], str]
    absent: Callable[[Facts], str] = lambda facts: ""
    differences: Callable[[Facts, Sequence[Level]], Sequence[Tensor]] | None = None
    error: Callable[[Facts, Level], Errors] | None = None
    added: str = "image"
    within: str = ""
    adds_to_parent: bool = False
    stage: str = "expose"
    one_pass: bool = False
    cuts: Values = field(default_factory=dict)


@dataclass(frozen=True)
class Decision:
    """One effect, whether this scene and camera have it, and what is done about it.

    effect: its name.
    called_for: whether leaving it out would be seen.
    chosen: what is simulated, in a word or two.
    why: one sentence.
    overruled: set by the user against the plan.
    error: of each channel if it is left out, in sensor units, None where that is not known.
    left: likewise, what the choice leaves out.
    seconds: what simulating it costs.
    stage: where.
    """

    effect: str
    called_for: bool
    chosen: str
    why: str
    overruled: bool = False
    error: Errors | None = None
    left: Errors = ()
    seconds: float = 0.0
    stage: str = "expose"


@dataclass(frozen=True)
class Plan:
    """All decisions, and the simulation that carries them out.

    error_db: predicted PSNR of the photo against the full simulation.
    asked_db: what was asked for, None where a time was.
    seconds: predicted, of each stage.
    memory_mib, disk_mib: predicted.
    note: what could not be had and why, or empty.
    target: what was asked for, as a sentence.
    full_seconds: predicted, of everything in full.
    replayed: the file or preset that gave the fidelity, empty where it was chosen: nothing is predicted then.
    """

    decisions: tuple[Decision, ...]
    fidelity: Fidelity
    error_db: float = float("inf")
    asked_db: float | None = None
    seconds: Mapping[str, float] = field(default_factory=dict)
    memory_mib: float = 0.0
    disk_mib: float = 0.0
    target: str = ""
    note: str = ""
    full_seconds: float = 0.0
    replayed: str = ""

    HEADS: ClassVar = ("effect", "called for", "simulated", "left out / dB", "cost / s", "why")

    def rows(self) -> list[tuple[str, ...]]:
        """The decisions as words, under `HEADS`."""
        return [
            (
                each.effect,
                "yes" if each.called_for else "no",
                each.chosen + (" (overruled)" if each.overruled else ""),
                f"{decibels(overall(each.error)):.1f}" if each.error is not None else "",
                f"{each.seconds:.2f}" if each.error is not None else "",
                each.why,
            )
            for each in self.decisions
        ]

    def summary(self) -> str:
        """What they come to as a whole, a sentence."""
        if self.replayed:
            return f"simulated as {self.replayed} says, without a plan"
        stages = ", ".join(f"{stage} {value:.2g} s" for stage, value in self.seconds.items() if value)
        whole = sum(self.seconds.values())
        return (
            f"asked for: {self.target}; predicted {self.error_db:.1f} dB in {whole:.2g} s "
            f"({stages}), {self.memory_mib:.0f} MiB of memory, {self.disk_mib:.0f} MiB of disk"
        )

    def saves(self) -> float:
        """Predicted seconds that the choice takes less than everything in full."""
        return max(0.0, self.full_seconds - sum(self.seconds.values()))

    def _repr_html_(self) -> str:
        return table_html(". ".join(filter(None, (self.summary(), self.note))), self.HEADS, self.rows())
