"""What a photo loses by the PSFs and the light of the axis all over the frame, of a lens that varies."""

from __future__ import annotations

import math
from dataclasses import replace

import torch

from ..capture.prepare import blur_per_dioptre
from ..core.once import Once
from ..errors import InputError
from ..optics import Camera, focus_distance
from ..optics.field import Frame, relative_light
from ..optics.pupil import StrongMask
from .effect import Errors
from .otfs import otfs_of
from .spectra import NODES, Spectra

ACROSS = 4
"""Parts of a frame's longer side that one place in the field stands for."""
OUTWARD = 1 / 8
"""Of a part, by which that place is farther from the axis than its middle: the mean over the outer part of a
frame lies there where squares of errors grow with the fourth to the eighth power of the distance."""
BLUR_PX = 32.0
"""Of depths that are blurred more, PSFs are alike all over the frame, and only light changes."""


def without_field(spectra: Spectra, frame: Frame) -> Errors:
    """Of each channel, all over the frame: each part of a tile by the PSFs and the light of a place in it, at
    one wavelength a channel.

    frame: where the view looks.
    """
    nodes = spectra.nodes_of_light(NODES)
    gathering = spectra.gathering(1, nodes)
    axial = spectra.otfs(spectra.full, gathering, nodes)
    light = spectra.light("channels", spectra.channels, nodes)
    level = (spectra.response @ spectra.mean)[:, None, None]
    squares, area = torch.zeros(len(level), dtype=torch.float64), 0.0
    away = (nodes - 1 / float(focus_distance(spectra.camera, float(gathering.wavelengths.median())))).abs()
    differs = torch.nonzero(away * blur_per_dioptre(spectra.camera) < BLUR_PX).flatten()
    for tile, rows, columns in spectra.tiles.parts(math.ceil(max(frame.height, frame.width) / ACROSS)):
        inside = zip(spectra.tiles.corners[tile], (rows, columns), frame.axis, strict=True)
        here, bright = _seen_at(spectra.camera, frame, *(_stands_for(*each) for each in inside))
        change = (bright - 1) * axial
        if bright and len(differs):
            how = (spectra.full, gathering, nodes[differs])
            change[differs] = bright * otfs_of(Once(), here, spectra.tiles.side, *how) - axial[differs]
        own = light.of_tile(tile)
        seen = spectra.image(nodes, change[:, :, None], replace(own, values=own.values[:, None]))[tile]
        taper = spectra.tiles.taper[tile]
        seen, window = (each[..., rows, columns] for each in (seen + (bright - 1) * level * taper, taper))
        amount = float(spectra.tiles.shares[tile]) * window.numel()
        squares += amount * seen.double().square().sum((1, 2)) / float(window.square().sum())
        area += amount
    return tuple((squares / area).sqrt().tolist())


def _stands_for(begin: int, part: slice, axis: float) -> float:
    """Along one side of a frame, the place whose error is about that of a part: what errs grows steeply away
    from the axis."""
    middle = begin + (part.start + part.stop) / 2
    return middle + math.copysign(OUTWARD * (part.stop - part.start), middle - axis)


def _seen_at(camera: Camera, frame: Frame, y: float, x: float) -> tuple[Camera, float]:
    """The camera that looks at a place, and the light there over that of the axis: 0 where it is dark."""
    try:
        here = camera.seen_at(frame.field(y, x))
        return here, relative_light(here)
    except StrongMask:
        raise
    except InputError:
        return camera, 0.0
