"""The hard cases that ship, which `evaluate stability` runs, and those of restoration, networks, training,
rendering and plans, which judge the code that ships and are of no use on a camera of one's own."""

from __future__ import annotations

from edofsim.stability import CASES as SHIPPED
from edofsim.stability import Case

from .convergence import CASES as CONVERGENCE
from .networks import CASES as NETWORKS
from .rendering import CASES as RENDERING
from .restoration import CASES as RESTORATION
from .training import CASES as TRAINING

CASES: tuple[Case, ...] = (*SHIPPED, *RESTORATION, *NETWORKS, *TRAINING, *RENDERING, *CONVERGENCE)

__all__ = ["CASES"]
