"""How long the system of a comparison was trained."""

from __future__ import annotations

from dataclasses import dataclass

from ..core.json_values import Json
from ..core.shipped import RENAMED


@dataclass(frozen=True)
class Training:
    """What a card tells of how long a system was trained.

    steps: with its own mask, all its trainings together.
    before: steps of another system, from whose weights it started.
    hours: of the own steps, None where the card does not say of all.
    """

    steps: int
    before: int
    hours: float | None


def training_of(card: Json) -> Training:
    """By a checkpoint's card (see `restore.checkpoint`)."""
    every = [*card.get("history", ()), card]
    names = [RENAMED.get(name, name) for name in (str(entry.get("name")) for entry in every)]
    own = [entry for entry, name in zip(every, names, strict=True) if name == names[-1]]
    steps = sum(int(entry.get("step", 0)) for entry in own)
    hours = sum(entry["hours"] for entry in own) if all("hours" in entry for entry in own) else None
    return Training(steps, sum(int(entry.get("step", 0)) for entry in every) - steps, hours)
