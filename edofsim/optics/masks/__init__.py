"""Masks at the pupil, one kind a file, and what all kinds have in common."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import torch
from pydantic import ValidationError
from torch import Tensor

from ...errors import InputError, first_line
from ...recipe.kinds import MASKS
from ..grid import PupilGrid, disc_amplitude, disc_coverage
from .base import Finite, Mask, PhaseMask, SmoothMask

__all__ = ["Finite", "Mask", "MaskEntry", "PhaseMask", "SmoothMask", "asked", "catalogue", "mask_amplitude"]

Answer = TypeVar("Answer")


def mask_amplitude(mask: Mask, grid: PupilGrid) -> tuple[Tensor, Tensor]:
    """(amplitude samples, light) of the aperture with its mask in each cell, float64 [samples, samples].

    Light is the mean squared amplitude. Where an edge crosses a cell it is more than the square of the
    sample: the difference is what the edge scatters beyond the replica period of the sampled pupil.
    """
    amplitude, light = disc_amplitude(grid, grid.radius), disc_coverage(grid, grid.radius)
    own = asked(mask, "transmission", lambda: mask.transmission(grid))
    return (amplitude, light) if own is None else (amplitude * own[0], light * own[1])


def asked(mask: Mask, what: str, answer: Callable[[], Answer]) -> Answer:
    """What a mask says of itself. Raises InputError, by its name, where a mask of another package fails, ends
    the program, or gives numbers that are not finite."""
    if not MASKS.of_another(mask.kind):
        return answer()
    place = f"the mask {mask.kind!r} of another package"
    try:
        found = answer()
    except InputError:
        raise
    except (Exception, SystemExit) as error:
        said = f"{type(error).__name__}: {first_line(error) if isinstance(error, Exception) else error}"
        raise InputError(f"{place} fails in {what} ({said}): mend or remove that package") from error
    if isinstance(found, tuple):
        bad = any(isinstance(part, Tensor) and not bool(torch.isfinite(part).all()) for part in found)  # pyrefly: ignore
    else:
        bad = isinstance(found, Tensor) and not bool(torch.isfinite(found).all())
    if bad:
        raise InputError(f"{place} gives values in {what} that are NaN or infinite: mend that package")
    return found


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
            continue  # a mask of another package that must be given more
        assert isinstance(example, Mask)  # what the registry holds
        summary, _, rest = (model.__doc__ or "").partition("\n")
        entries.append(MaskEntry(kind, example, summary.strip(), " ".join(rest.split())))
    return tuple(entries)
