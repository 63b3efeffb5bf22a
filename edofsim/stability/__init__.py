"""Hard cases: a named catalogue that runs every method, mask and precision against a truth."""

from __future__ import annotations

from .case import Case, Finding
from .depth_cases import CASES as DEPTH
from .light_cases import CASES as LIGHT
from .pupils import CASES as PUPILS
from .rendering import CASES as RENDERING
from .restoration import CASES as RESTORATION
from .training import CASES as TRAINING

CASES: tuple[Case, ...] = (*DEPTH, *LIGHT, *PUPILS, *RESTORATION, *TRAINING, *RENDERING)

__all__ = ["CASES", "Case", "Finding"]
