"""The choice of a filter bank, learned before the rest.

Which of its filters fits shows in the photo alone, but a network that also learns to mend what filters
leave mends at first what a wrong filter did, and chooses late. So the choice alone is trained first, by the
PSNR of what is chosen.
"""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor

from ..restore.filter_bank import FilterBank
from .schedule import rate_factor
from .system import Draw, System

RATE = 5e-3
SMALLEST_ERROR = 1e-5  # mean square error: below 50 dB nothing is left to choose


def learn_choice(
    system: System,
    draw: Callable[[int], Draw],
    steps: int,
    progress: Callable[[float, str], None] | None = None,
) -> float:
    """Train the choice of the system's filter bank, in place; nothing else of it changes.

    draw: the scenes of a step by its number. Returns by how many dB the choice fell short of the best single
    filter in the last steps, mean over photos.
    """
    network = system.network
    if not isinstance(network, FilterBank):
        raise TypeError(f"a {network.kind!r} has no filters to choose from")
    optimiser = torch.optim.Adam(network.choice.parameters(), lr=RATE)
    margin = network.support // 2
    short: list[float] = []
    for step in range(steps):
        for group in optimiser.param_groups:
            group["lr"] = RATE * rate_factor(step / steps, "cosine", 0.0, 0.02)
        with torch.no_grad():
            photo, ideal = system.photographed(draw(step))
            filtered = network.filtered(photo)
            each = _error(filtered - ideal[:, None], margin)
        error = _error((network.chosen(photo, filtered) - ideal)[:, None], margin)[:, 0]
        optimiser.zero_grad(set_to_none=True)
        (error + SMALLEST_ERROR).log().mean().backward()
        optimiser.step()
        short = [*short[-19:], float((10 * (error.detach() / each.amin(1)).log10()).mean())]
        if progress and step % 10 == 0:
            progress(0.0, f"choice alone, step {step}: {sum(short) / len(short):.2f} dB from the best filter")
    return sum(short) / max(len(short), 1)


def _error(difference: Tensor, margin: int) -> Tensor:
    """Mean square of [batch, group, 3, y, x] for each group, without the border that filters cannot know."""
    inside = difference
    if min(difference.shape[-2:]) > 3 * margin:
        inside = difference[..., margin:-margin, margin:-margin]
    return inside.square().mean((2, 3, 4))
