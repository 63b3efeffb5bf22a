"""The effects that a plan decides on, each in a file. To add one: a file, and a line here, or an entry point
of another package.

An effect of another package leaves something out of the camera by a `Simplification` of `capture.fidelity`.
"""

from __future__ import annotations

from ...core.registry import Registry
from ...errors import InputError
from ..effect import Effect

HERE = "edofsim.plan.effects"

EFFECTS: Registry[Effect] = Registry(
    "edofsim.plan_effects",
    "effect",
    {
        "bands": f"{HERE}.bands:EFFECT",
        "depth layers": f"{HERE}.depth_layers:EFFECT",
        "occlusion": f"{HERE}.occlusion:EFFECT",
        "hidden surfaces": f"{HERE}.hidden:EFFECT",
        "sub-apertures": f"{HERE}.sub_apertures:EFFECT",
        "spherical aberration": f"{HERE}.spherical_aberration:EFFECT",
        "dispersion of the lens": f"{HERE}.lens_dispersion:EFFECT",
        "dispersion of the DOE": f"{HERE}.doe_dispersion:EFFECT",
        "pixel integration": f"{HERE}.pixel:EFFECT",
        "PSF window": f"{HERE}.window:EFFECT",
        "pupil sampling": f"{HERE}.pupil:EFFECT",
        "field dependence": f"{HERE}.field_dependence:EFFECT",
        "light from outside": f"{HERE}.outside:EFFECT",
        "fabrication error": f"{HERE}.fabrication:EFFECT",
        "read noise": f"{HERE}.read_noise:EFFECT",
        "shot noise": f"{HERE}.shot_noise:EFFECT",
        "quantisation": f"{HERE}.quantisation:EFFECT",
        "saturation": f"{HERE}.saturation:EFFECT",
        "Bayer mosaic": f"{HERE}.mosaic:EFFECT",
        "interreflection": f"{HERE}.bounces:EFFECT",
        "dispersion of scene glass": f"{HERE}.scene_dispersion:EFFECT",
        "render samples": f"{HERE}.samples:EFFECT",
    },
    "edofsim.plan.effect:Effect",
)
RENAMED = {
    "pupil parts": "sub-apertures",
    "exact lens": "spherical aberration",
    "hero wavelengths": "dispersion of scene glass",
}
"""Names that effects had, and theirs now."""
GONE = {"rank": "no PSFs are factored any more: bands are gathered in groups instead, see the effect `bands`"}
"""Effects that there were, and what became of them; asking for them changes nothing."""


def all_effects() -> tuple[Effect, ...]:
    """Every effect that there is. Raises InputError for one of another package that is none."""
    for name, effect in EFFECTS.items():
        if effect.name != name:
            raise InputError(f"the effect {name!r} of another package is no Effect of that name: {effect!r}")
    return tuple(EFFECTS.values())


__all__ = ["EFFECTS", "GONE", "RENAMED", "all_effects"]
