"""All hard cases: those of `evaluate stability` with PSFs that are written out, and those that judge the code
that ships and are of no use on a camera of one's own: pupils, sensors, occlusion by rays, restoration,
networks, training, rendering and plans."""

from __future__ import annotations

from edofsim.stability import Case, camera_cases, small_cameras, white_wall

from .convergence import CASES as CONVERGENCE
from .light import CASES as LIGHT
from .networks import CASES as NETWORKS
from .occlusion import CASES as OCCLUSION
from .psfs import CASES as PSFS
from .pupils import CASES as PUPILS
from .rendering import CASES as RENDERING
from .restoration import CASES as RESTORATION
from .sensor import CASES as SENSOR
from .slanted_plane import CASES as SLANTED
from .training import CASES as TRAINING
from .written_photos import CASES as PHOTOS

WHITE = white_wall.cases_of(white_wall.shipped_cameras)
CASES: tuple[Case, ...] = (
    *(
        *PHOTOS,
        *WHITE,
        *camera_cases.cases_of(small_cameras),
        *OCCLUSION,
        *SLANTED,
        *LIGHT,
        *PUPILS,
        *PSFS,
        *SENSOR,
    ),
    *(*RESTORATION, *NETWORKS, *TRAINING, *RENDERING, *CONVERGENCE),
)

__all__ = ["CASES"]
