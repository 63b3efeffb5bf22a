"""What a plan is made of: effects, and the decision on each."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class Decision:
    """One effect, whether this scene and camera have it, and what is done about it.

    effect: its name; called_for: whether the scene and camera have it at all; chosen: what is simulated, in
    a word or two; why: one sentence; overruled: set by the user against the plan.
    """

    effect: str
    called_for: bool
    chosen: str
    why: str
    overruled: bool = False


@dataclass(frozen=True)
class Plan:
    """All decisions, and the settings of `expose` that carry them out."""

    decisions: tuple[Decision, ...]
    settings: Mapping[str, Any] = field(default_factory=dict)
