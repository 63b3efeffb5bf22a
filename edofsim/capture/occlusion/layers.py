"""Occlusion as RGB-D compositors do it: layers at the depth nodes, of what is visible, front to back.

What a near surface hides is not known to them. `over` leaves a dark fringe where light of the hidden surface
is missing; `normalised` fills it with light from next to it, which is better, and wrong where the front is
blurred over something sharp.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import accumulate

import torch
from torch import Tensor

from ...render.view import View
from ..blurring import Blurring
from ..light import hat_weights, seen

LITTLE = 1e-4
"""Coverage below which nothing of a layer is there to be normalised."""


def over(view: View, blurring: Blurring) -> Tensor:
    """Each layer's blurred light, dimmed by the blurred coverage of all in front of it.

    photo = sum_l L_l prod_{m nearer than l} (1 - A_m). Returns [channel, y, x] of the padded frame.
    """
    near_to_far = _layers(view, blurring)
    photo, coverage = next(near_to_far)
    clear = (1 - coverage).clamp(0, 1)
    for light, coverage in near_to_far:
        photo = photo + clear * light
        clear = (clear * (1 - coverage)).clamp(0, 1)
    return photo


def normalised(view: View, blurring: Blurring) -> Tensor:
    """Ikoma et al. 2021 (*Depth from defocus with learned optics*, Eq. 4): as `over`, each layer's light and
    coverage divided by the blurred coverage of the layer and all behind it. [channel, y, x], padded frame.
    """
    layers = list(_layers(view, blurring))
    behind = list(accumulate(coverage for _, coverage in reversed(layers)))
    photo, clear = torch.zeros_like(behind[0]), torch.ones_like(behind[0])
    for (light, coverage), whole in zip(layers, reversed(behind), strict=True):
        there = whole.clamp_min(LITTLE)
        photo = torch.addcdiv(photo, clear * light, there)
        clear = clear * (1 - coverage / there).clamp(0, 1)
    return photo


def _layers(view: View, blurring: Blurring) -> Iterator[tuple[Tensor, Tensor]]:
    """Blurred light and coverage of each occupied node, near to far; a fragment is at the nearest node."""
    nodes = blurring.psfs.inverse_depths.to(view.inverse_depth)
    which = seen(view)
    cell, share = hat_weights(view.inverse_depth[which], nodes)
    node = cell + (share > 0.5).long()
    snapped = view.inverse_depth.index_put((which,), nodes[node])
    layered = replace(view, inverse_depth=snapped)
    for each in torch.bincount(node).nonzero().flip(0):
        members = which[node == each]
        yield blurring.light(layered, members), blurring.coverage(layered, members, view.coverage[members])
