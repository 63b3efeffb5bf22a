"""Which inverse depths stand for a range: as many, and as close, as the camera's PSFs ask for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import torch
from torch import Tensor
from torch.nn import functional

from .camera import Camera
from .contrast import contrast_transfer, transfers_apart
from .psf import axes_of, psf_bank
from .sampling import sampled_alike
from .sensor import response

DIFFERENCE = 0.08
"""Of photos at neighbouring nodes, see `nodes_between`."""
MOST = 257
"""Nodes, at most: each takes memory for its PSFs and time for their transforms."""
PARTS = 4
"""Equal parts of a range that are looked at first."""
HALVINGS = 14
"""Of a part, at most."""
STRAIGHT = 0.9
"""Of the sum of a part's halves: where photos at its ends differ by as much, nothing happens in between."""


def nodes_between(
    camera: Camera,
    wavelengths: Tensor | Sequence[float],
    far: Tensor | float,
    near: Tensor | float,
    *,
    difference: float = DIFFERENCE,
    most: int = MOST,
) -> Tensor:
    """Inverse depths that stand for all between two, chosen by the camera.

    The range is halved, and its halves again, until photos of one picture at both ends of a part and at its
    middle differ by less than `difference`: in the root mean square, relative to the contrast of the picture,
    whose power spectrum falls with the square of the frequency (Field, JOSA A 4, 1987), in the colour where
    they differ most. So nodes are close where a lens is sharp, and far apart where a large blur becomes a
    little larger; wide apertures and small pixels ask for many. A colour is looked at by the mean wavelength
    of its response. A half whose ends differ by less is not halved again where photos change along a straight
    line: where the ends of the whole differ by nearly the sum of both halves. Nothing else decides: the same
    camera has the same nodes everywhere.

    Networks that were trained with a fixed number of PSFs keep theirs (`Restorer.psf_depths`).

    camera: as it is simulated, with its mask.
    wavelengths: [band], metres, of the light that the sensor adds up.
    far: scalar [], the least inverse depth, 1/m.
    near: scalar [], the largest, 1/m.
    difference: of photos at neighbouring nodes.
    most: nodes; where a camera asks for more, those parts that differ most are halved.

    Returns float64 [node], 1/m, ascending from `far` to `near`; one where these are equal.
    Raises InputError as `psf_bank`.
    """
    bands = torch.as_tensor(wavelengths, dtype=torch.float64).flatten().cpu()
    colours, ends = axes_of(camera, response(camera, bands) @ bands, [float(far), float(near)])
    if ends[0] == ends[1]:
        return ends[:1]
    camera = camera.without_gradients()
    found = torch.linspace(float(ends[0]), float(ends[1]), PARTS + 1, dtype=torch.float64).tolist()
    known = _transfers(camera, colours, found)
    parts = list(zip(found[:-1], found[1:], strict=True))
    for _ in range(HALVINGS):
        middles = [(first + last) / 2 for first, last in parts]
        known |= _transfers(camera, colours, middles)
        apart = {part: _apart(known, *part) for part in parts}
        wide = sorted((p for p in parts if max(apart[p]) >= difference), key=lambda p: -max(apart[p]))
        wide = sorted(wide[: max(0, most - len(found))])
        parts = []
        for first, last in wide:
            middle = (first + last) / 2
            found.append(middle)
            whole, *halves = apart[first, last]
            for half, size in zip(((first, middle), (middle, last)), halves, strict=True):
                if size >= difference or whole < STRAIGHT * sum(halves):
                    parts.append(half)
        if not parts:
            break
        known = {place: known[place] for part in parts for place in part}
    return torch.tensor(sorted(found), dtype=torch.float64)


def node_shares(nodes: Tensor) -> Tensor:
    """What part of a range each of its nodes stands for, all inverse depths of it equally likely.

    nodes: [node], 1/m, ascending.

    Returns float64 [node] with the sum 1: the trapezoidal rule's weights.
    """
    nodes = nodes.double().cpu()
    if len(nodes) == 1:
        return torch.ones_like(nodes)
    gaps = functional.pad(nodes.diff(), (1, 1))
    return (gaps[:-1] + gaps[1:]) / (2 * (nodes[-1] - nodes[0]))


def _apart(known: Mapping[float, Tensor], first: float, last: float) -> list[float]:
    """How photos at the ends of a part differ, and at those of its halves."""
    middle = (first + last) / 2
    pairs = ((first, last), (first, middle), (middle, last))
    return [transfers_apart(known[one], known[other]) for one, other in pairs]


def _transfers(camera: Camera, colours: Tensor, places: Sequence[float]) -> dict[float, Tensor]:
    """Transfer functions [colour, y, x // 2 + 1] by inverse depth, each frequency by its share of the
    contrast of a picture; the pupil is sampled as finely as each depth asks for."""
    depths = torch.tensor(places, dtype=torch.float64)
    found: dict[float, Tensor] = {}
    for some, _ in sampled_alike(camera, colours, depths, camera.recipe.psf.window_px):
        psf = psf_bank(camera, colours, depths[some]).values
        found |= zip(depths[some].tolist(), contrast_transfer(psf), strict=True)
    return found
