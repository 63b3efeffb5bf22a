"""Choosing a coded aperture as Levin et al. do: the pattern whose blurs of different sizes differ most.

A. Levin, R. Fergus, F. Durand, W. T. Freeman, "Image and depth from a conventional camera with a coded
aperture", ACM Trans. Graph. 26, 70 (2007), section 3: natural images have Gaussian statistics in frequency,
a blur K of some size gives them the variance |K|^2 S + noise^2, and the pattern is to have the largest
Kullback-Leibler divergence between its two most similar sizes. Their own pattern is shown as a picture only;
`PATTERN` is what `search(0)` picks by their criterion from the same class: 13 x 13 cells, binary, cut from
one piece.
"""

from __future__ import annotations

import math
from functools import lru_cache

import torch
from torch import Tensor

CODE_CELLS = 13
SIZES_PX = (5, 6, 7, 8, 9, 11, 13, 15)
"""Widths of the blur that are distinguished, in pixels: eight between 5 and 15, as they use."""
FREQUENCIES = 24
NOISE = 0.005
CANDIDATES = 500

PATTERN = (
    "0000111110000",
    "0001001000000",
    "0001100001000",
    "0111110011110",
    "1100100110010",
    "1000001000011",
    "1000100000110",
    "1100000100010",
    "1110000000011",
    "0101100000110",
    "0001000111010",
    "0010011111000",
    "0000111110000",
)
"""Rows from the top; "1" is open."""


def discrimination(pattern: Tensor) -> float:
    """Least Kullback-Leibler divergence between blurs of neighbouring sizes, a frequency, for [13, 13] cells.

    pattern: [13, 13], 0 or 1.

    The larger, the better a blur's size can be determined. 0 for a pattern that lets no light through.
    """
    light = float(pattern.sum())
    if light == 0:
        return 0.0
    prior, bases = _bases()
    cells = pattern.to(torch.complex128) / light
    variances = [(rows @ cells @ columns).abs() ** 2 * prior + NOISE**2 for rows, columns in bases]
    divergences = []
    for here, there in zip(variances, variances[1:], strict=False):
        ratio = here / there
        divergences.append(float((ratio - ratio.log() - 1).mean()))
        divergences.append(float((1 / ratio + ratio.log() - 1).mean()))
    return min(divergences)


def random_pattern(generator: torch.Generator) -> Tensor:
    """Random open (1) and opaque (0) cells [13, 13] in the pupil's disc, cut from one piece."""
    return _in_one_piece((torch.rand(CODE_CELLS, CODE_CELLS, generator=generator) < 0.5).double())


def search(seed: int) -> Tensor:
    """The best of many random patterns, then improved by flipping single cells as long as that helps."""
    generator = torch.Generator().manual_seed(seed)
    best = max((random_pattern(generator) for _ in range(CANDIDATES)), key=discrimination)
    value, improved = discrimination(best), True
    while improved:
        improved = False
        for cell in torch.randperm(CODE_CELLS**2, generator=generator).tolist():
            changed = best.clone()
            changed.view(-1)[cell] = 1 - changed.view(-1)[cell]
            changed = _in_one_piece(changed)
            if (attempt := discrimination(changed)) > value:
                best, value, improved = changed, attempt, True
    return best


def _in_one_piece(opened: Tensor) -> Tensor:
    """The pattern with cells outside the disc closed, and opaque cells that nothing holds cut out."""
    axis = (torch.arange(CODE_CELLS, dtype=torch.float64) - (CODE_CELLS - 1) / 2) / (CODE_CELLS / 2)
    inside = axis[:, None] ** 2 + axis[None, :] ** 2 <= 1
    opaque = (opened == 0) | ~inside
    held = ~inside
    while True:
        padded = torch.nn.functional.pad(held, (1, 1, 1, 1), value=True)
        touched = padded[:-2, 1:-1] | padded[2:, 1:-1] | padded[1:-1, :-2] | padded[1:-1, 2:]
        grown = held | (touched & opaque)
        if bool((grown == held).all()):
            return (~held).double()
        held = grown


@lru_cache(maxsize=1)
def _bases() -> tuple[Tensor, list[tuple[Tensor, Tensor]]]:
    """Power of natural images, 1 / f^2, on half of the frequency plane, and for each size of blur the factors
    of a pattern's transform, |rows @ cells @ columns|.
    """
    frequency = torch.linspace(0.5 / FREQUENCIES, 0.5, FREQUENCIES, dtype=torch.float64)
    both = torch.cat([-frequency.flip(0), frequency])
    prior = frequency[0] ** 2 / (both[:, None] ** 2 + frequency[None, :] ** 2)

    def transform(axis: Tensor, cell: float) -> Tensor:
        centres = (torch.arange(CODE_CELLS, dtype=torch.float64) - (CODE_CELLS - 1) / 2) * cell
        opening = torch.sinc(axis * cell)[:, None].expand(-1, CODE_CELLS)
        return torch.polar(opening, -2 * math.pi * axis[:, None] * centres)

    sizes = [size / CODE_CELLS for size in SIZES_PX]
    return prior, [(transform(both, cell), transform(frequency, cell).T) for cell in sizes]
