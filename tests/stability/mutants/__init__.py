"""Simulators broken on purpose, which the hard cases must notice."""

from __future__ import annotations

from .mutant import Mutant, applied
from .occlusion import MUTANTS as OCCLUSION
from .optics import MUTANTS as OPTICS
from .photos import MUTANTS as PHOTOS
from .plans import MUTANTS as PLANS
from .renderer import MUTANTS as RENDERER
from .restoring import MUTANTS as RESTORING
from .sensor import MUTANTS as SENSOR

MUTANTS: tuple[Mutant, ...] = (*PHOTOS, *OCCLUSION, *OPTICS, *SENSOR, *RESTORING, *RENDERER, *PLANS)

__all__ = ["MUTANTS", "Mutant", "applied"]
