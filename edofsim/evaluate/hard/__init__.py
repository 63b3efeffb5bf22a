"""Hard cases: a named catalogue that runs every method, mask and precision against a truth."""

from __future__ import annotations

from .case import Case, Finding
from .photo_cases import CASES as PHOTOS
from .pupils import CASES as PUPILS
from .rendering import CASES as RENDERING
from .restoration import CASES as RESTORATION
from .training import CASES as TRAINING

CASES: tuple[Case, ...] = (*PHOTOS, *PUPILS, *RESTORATION, *TRAINING, *RENDERING)

__all__ = ["CASES", "Case", "Finding"]
