"""Masks at the pupil, one kind a file, and what all kinds have in common."""

from __future__ import annotations

from dataclasses import dataclass

from pydantic import ValidationError
from torch import Tensor

from ...recipe.kinds import MASKS
from ..grid import PupilGrid, disc_amplitude, disc_coverage
from .base import Finite, Mask, PhaseMask, SmoothMask

__all__ = ["Finite", "Mask", "MaskEntry", "PhaseMask", "SmoothMask", "catalogue", "mask_amplitude"]


def mask_amplitude(mask: Mask, grid: PupilGrid) -> tuple[Tensor, Tensor]:
    """(amplitude samples, light) of the aperture with its mask in each cell, float64 [samples, samples].

    Light is the mean squared amplitude. Where an edge crosses a cell it is more than the square of the
    sample: the difference is what the edge scatters beyond the replica period of the sampled pupil.
    """
    amplitude, light = disc_amplitude(grid, grid.radius), disc_coverage(grid, grid.radius)
    own = mask.transmission(grid)
    return (amplitude, light) if own is None else (amplitude * own[0], light * own[1])


@dataclass(frozen=True)
class MaskEntry:
    """What the registry knows of a kind of mask: a default recipe, its meaning in a line, its reference."""

    kind: str
    example: Mask
    summary: str
    reference: str


def catalogue() -> tuple[MaskEntry, ...]:
    """All kinds of mask that have defaults, in the order of the registry, each with these."""
    entries = []
    for kind, model in MASKS.items():
        try:
            example = model(kind=kind)
        except ValidationError:
            continue  # a mask of another package that must be told more
        assert isinstance(example, Mask)  # what the registry holds
        summary, _, rest = (model.__doc__ or "").partition("\n")
        entries.append(MaskEntry(kind, example, summary.strip(), " ".join(rest.split())))
    return tuple(entries)
