"""Pupil sampling: how finely the wave in the pupil is resolved."""

from __future__ import annotations

import torch

from ...capture.fidelity import coarsest_pupil_um, pupil_is_free
from ...optics.sampling import plan_sampling
from ..effect import Effect, Level
from ..facts import Facts

MIDDLE_LEVEL_FROM = 1.6
"""From this ratio of the coarsest to the finest pitch on, there is a level between them."""


def absent(facts: Facts) -> str:
    return "" if pupil_is_free(facts.camera) else "the recipe, or the squares of a made mask, say how finely"


def levels(facts: Facts) -> list[Level]:
    coarsest = coarsest_pupil_um(facts.camera, facts.view.wavelengths, facts.view.inverse_depth)
    finest = pitch_um(facts)
    ratio = coarsest / finest
    if ratio < 1.05:
        return [Level(f"{finest:.1f} um", {})]
    pitches = [coarsest, finest * ratio**0.5] if ratio > MIDDLE_LEVEL_FROM else [coarsest]
    coarser = [Level(f"{pitch:.1f} um", {"pupil_sampling_um": pitch}) for pitch in pitches]
    return [*coarser, Level(f"{finest:.1f} um", {})]


def pitch_um(facts: Facts) -> float:
    """Pitch of the automatic sampling."""
    ends = torch.tensor(facts.ends, dtype=torch.float64)
    window = facts.camera.recipe.psf.window_px
    return plan_sampling(facts.camera, facts.view.wavelengths, ends, window).pitch * 1e6


def why(facts: Facts) -> str:
    return "the steepest phase of lens, defocus and mask together decides, and where a mask scatters light"


EFFECT = Effect(
    "pupil sampling",
    levels,
    why,
    absent,
    stage="psf",
)
