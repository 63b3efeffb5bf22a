"""Hard cases: a named catalogue that runs every method, mask and precision against a truth."""

from __future__ import annotations

from .case import Case, Finding
from .depth_cases import CASES as DEPTH
from .light_cases import CASES as LIGHT
from .occlusion_cases import CASES as OCCLUSION
from .psf_cases import CASES as PSFS
from .pupils import CASES as PUPILS
from .sensor_cases import CASES as SENSOR
from .white_wall import CASES as WHITE

CASES: tuple[Case, ...] = (*DEPTH, *OCCLUSION, *WHITE, *LIGHT, *PUPILS, *PSFS, *SENSOR)

__all__ = ["CASES", "Case", "Finding"]
