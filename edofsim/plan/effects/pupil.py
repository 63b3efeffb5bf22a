"""Pupil sampling: how finely the wave in the pupil is resolved."""

from __future__ import annotations

from ...optics.sampling import plan_sampling
from ..effect import Effect, Level
from ..facts import Facts
from ..simulation import coarsest_pupil_um, pupil_is_free


def absent(facts: Facts) -> str:
    if pupil_is_free(facts.camera) and facts.sample.height is None:
        return ""
    return "the recipe, or the mask's own samples, say how finely"


def levels(facts: Facts) -> list[Level]:
    coarsest = coarsest_pupil_um(facts.camera, facts.view.wavelengths, facts.view.inverse_depth)
    finest = pitch_um(facts)
    if coarsest < 1.05 * finest:
        return [Level(f"{finest:.1f} um", {})]
    return [Level(f"{coarsest:.1f} um", {"pupil_um": coarsest}), Level(f"{finest:.1f} um", {})]


def pitch_um(facts: Facts) -> float:
    """Pitch of the automatic sampling."""
    ends = facts.view.inverse_depth.new_tensor(facts.sample.ends).double()
    found = plan_sampling(facts.camera, facts.view.wavelengths, ends, facts.camera.recipe.psf.window_px)
    return found.grid.pitch * 1e6


def why(facts: Facts) -> str:
    return "the steepest phase of lens, defocus and mask together decides"


EFFECT = Effect(
    "pupil sampling",
    levels,
    why,
    absent,
    # in the whole window: the replicas of a coarse pupil come in from its rim
    sample={"groups": 1, "colours": 2, "layers": 5, "snapped": True, "occlusion": "none", "window": None},
    stage="psf",
)
