"""Hard cases: a named catalogue that runs every method, mask and precision against a truth."""

from __future__ import annotations

from .case import Case, Finding
from .depth_cases import CASES as DEPTH
from .light_cases import CASES as LIGHT
from .network_cases import CASES as NETWORKS
from .occlusion_cases import CASES as OCCLUSION
from .psf_cases import CASES as PSFS
from .pupils import CASES as PUPILS
from .rendering import CASES as RENDERING
from .restoration import CASES as RESTORATION
from .sensor_cases import CASES as SENSOR
from .training import CASES as TRAINING

CASES: tuple[Case, ...] = (
    *DEPTH,
    *OCCLUSION,
    *LIGHT,
    *PUPILS,
    *PSFS,
    *SENSOR,
    *RESTORATION,
    *NETWORKS,
    *TRAINING,
    *RENDERING,
)

__all__ = ["CASES", "Case", "Finding"]
