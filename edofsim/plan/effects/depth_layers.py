"""Depth layers: the blur changes with depth; PSFs between the layers are interpolated."""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
from torch import Tensor

from ...core.words import metres
from ..effect import Effect, Level
from ..facts import Facts

TINY = 1e-30
LAYERS = (1, 2, 3, 4, 5, 7, 9, 13, 15, 17, 21, 25, 29, 33)


def absent(facts: Facts) -> str:
    if facts.depth_count == 1:
        return f"everything lies at {metres(facts.ends[1])}: one convolution a band is exact"
    return ""


def levels(facts: Facts) -> list[Level]:
    most = facts.layers_of(None)
    # few depths lie at no nodes but their own: nearly as many layers save little, and err like fewer
    useful = most if facts.depths is None else most // 2 + 1
    few = [Level(_label(n), {"layers": n}) for n in LAYERS if n < min(most, useful)]
    full = f"{facts.depth_count} layers" if facts.depth_count else "all layers"
    return [*few, Level(full, {"layers": None})]


def _label(count: int) -> str:
    return f"{count} layer{'s'[: count > 1]}"


def why(facts: Facts) -> str:
    far, near = facts.ends
    spread = f"depths from {metres(near)} to {metres(far)} change the blur by {facts.blur_spread:.1f} pixels"
    filled = facts.view.metadata.get("holes filled")
    return f"{spread}; holes of the depth map were filled: {filled}" if filled else spread


def differences(facts: Facts, levels: Sequence[Level]) -> list[Tensor]:
    return [_difference(facts, int(level.change["layers"])) for level in levels]


def _difference(facts: Facts, layers: int) -> Tensor:
    # judged by nodes at most half as far apart; the error of more layers falls with the square of their step
    fine = facts.spectra.fine_nodes
    measured = (fine + 1) // 2
    if facts.depths is not None or layers <= measured:
        missed = 0.0 if facts.depths is not None else ((layers - 1) / (fine - 1)) ** 2
        return facts.spectra.by_layers(layers) / (1 - missed)
    # from the one of two in whose steps light lies most as it does in those of more
    some = [coarser for coarser in LAYERS if coarser <= measured][-2:]
    apart = {coarser: _apart(facts, coarser, layers) for coarser in some}
    coarser = min(some, key=lambda one: abs(math.log(apart[one])))
    return _difference(facts, coarser) * ((coarser - 1) / (layers - 1)) ** 2 * max(1.0, apart[coarser])


def _apart(facts: Facts, coarser: int, layers: int) -> float:
    """Factor on the error of more layers, next to the square of their step, by where light lies in a step: a
    lamp in its middle errs most, and one at a node not at all."""
    spectra, (low, high) = facts.spectra, facts.ends
    power = spectra.channels[:, : len(spectra.seen)].double().square().sum(0)
    place = (spectra.seen.depth.double() - low) / (high - low)

    def missed(place: Tensor, count: int) -> Tensor:
        part = place * (count - 1) % 1
        return part * (1 - part)

    # as the nodes that it is judged by see it
    fine = place * (spectra.fine_nodes - 1)
    node = fine.floor()
    before, after = (missed((node + end) / (spectra.fine_nodes - 1), coarser) for end in (0, 1))
    seen = torch.lerp(before, after, fine - node)
    of_more, of_few = (float(power @ found.square()) for found in (missed(place, layers), seen))
    return math.sqrt(max(of_more, TINY) / max(of_few, TINY))


EFFECT = Effect("depth layers", levels, why, absent, differences)
