"""Field dependence: the PSF of a lens changes over the frame."""

from __future__ import annotations

from ...optics.field import STEPS
from ..effect import Effect, Errors, Level
from ..facts import Facts


def absent(facts: Facts) -> str:
    return "" if facts.camera.lens.varies else "the lens has the same PSF all over the frame"


def levels(facts: Facts) -> list[Level]:
    some = [Level(f"every {step} px", {"field_step_px": step}) for step in STEPS]
    return [Level("that of the axis", {"field_step_px": 0}), *some, Level("as fine as depth layers", {})]


def error(facts: Facts, level: Level) -> Errors:
    """By the contrast of a picture of which nothing else is known, at the worst of three places."""
    found = facts.joined[level.change["field_step_px"]] if level.change else 0.0
    return (found,) * len(facts.response)


def why(facts: Facts) -> str:
    return "aberrations, vignetting and illumination of the lens change with the place in the frame"


EFFECT = Effect("field dependence", levels, why, absent, error=error, added="noise", stage="psf")
