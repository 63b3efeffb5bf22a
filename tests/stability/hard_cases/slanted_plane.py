"""A white plane that slants, through cameras with one PSF for each point.

A plane that slants is thinned by blurring each of its points by a PSF of its own (the paper's Eqs.
`Forwardmodel` and `SensorImage`): where the blur's radius grows by b pixels a pixel, light that passes the
pupil at u, in radii, lands 1 + b u pixels from where its neighbour's does, and the mean over a round pupil of
1 / (1 + b u) is more than 1. A real plane is foreshortened as much differently from each place of the pupil,
which keeps it white; no PSF knows that. See `thinned`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import torch

from edofsim.capture.prepare import blur_per_dioptre
from edofsim.optics import Camera
from edofsim.render.view import View
from edofsim.stability.case import Case, Finding, timed
from edofsim.stability.white_wall import CAMERAS, FAR, MARGIN, NEAR, SIDE, WAYS, off, white

SLANTED = 0.002
"""Of a slanted plane from the closed form."""


def slanted(camera: Camera) -> View:
    """A white plane from 3 m at the top to 0.6 m at the bottom of the frame with its margin."""
    size = SIDE + 2 * MARGIN
    return white(camera, torch.linspace(FAR, NEAR, size)[:, None].expand(size, size))


def thinned(camera: Camera) -> float:
    """What `slanted` becomes where each of its points has a PSF of its own, by rays through a round pupil:
    2 (1 - sqrt(1 - b^2)) / b^2 for a blur whose radius grows by b pixels a pixel."""
    grows = blur_per_dioptre(camera) / 2 * (NEAR - FAR) / (SIDE + 2 * MARGIN - 1)
    return 2 * (1 - math.sqrt(1 - grows**2)) / grows**2


def _plane() -> Iterator[Finding]:
    for name, make in CAMERAS.items():
        camera = make()
        view, truth = slanted(camera), thinned(camera)
        for way in ("none", "hidden"):
            yield timed(
                f"{way}, {name}, white becomes {truth:.4f}",
                SLANTED,
                lambda v=view, c=camera, w=way, t=truth: off(v, c, WAYS[w], t),
            )


CASES: tuple[Case, ...] = (
    Case(
        "white slanted plane",
        "occlusion",
        "blur that grows along a surface without edges",
        "a seam where depth layers meet; what is thinned is taken for an edge",
        "even, and brighter than white by what scattering each point by itself adds",
        _plane,
    ),
)
