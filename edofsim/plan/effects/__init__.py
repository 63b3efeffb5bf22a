"""The effects that a plan decides on. To add one: an `Effect` in a file and a line here, or an entry point of
another package.

An effect of another package leaves something out of the camera by a `Simplification` of `capture.fidelity`.
An effect of the sensor needs none: it is left out by its kind.
"""

from __future__ import annotations

from ...core.registry import Registry
from ...errors import InputError
from ...recipe.kinds import SENSOR_EFFECTS
from ..effect import Effect
from .sensor import of_kind

HERE = "edofsim.plan.effects"


class _Effects(Registry[Effect]):
    """Effects of plans, and one for each of the sensor's effects that other packages add without one."""

    @property
    def _sensor(self) -> list[str]:
        known = {name.replace(" ", "-") for name in super()._places}
        return [kind for kind in SENSOR_EFFECTS if SENSOR_EFFECTS.of_another(kind) and kind not in known]

    @property
    def _places(self) -> dict[str, str]:
        return super()._places | {kind: SENSOR_EFFECTS.place(kind) for kind in self._sensor}

    def __getitem__(self, name: str) -> Effect:
        return of_kind(name) if name in self._sensor else super().__getitem__(name)


EFFECTS: Registry[Effect] = _Effects(
    "edofsim.plan_effects",
    "effect",
    {
        "bands": f"{HERE}.bands:EFFECT",
        "depth layers": f"{HERE}.depth_layers:EFFECT",
        "occlusion": f"{HERE}.occlusion:OCCLUSION",
        "hidden surfaces": f"{HERE}.occlusion:HIDDEN",
        "sub-apertures": f"{HERE}.sub_apertures:EFFECT",
        "spherical aberration": f"{HERE}.optics:SPHERICAL_ABERRATION",
        "dispersion of the lens": f"{HERE}.optics:LENS_DISPERSION",
        "dispersion of the DOE": f"{HERE}.optics:DOE_DISPERSION",
        "pixel integration": f"{HERE}.optics:PIXEL",
        "PSF window": f"{HERE}.window:EFFECT",
        "pupil sampling": f"{HERE}.pupil:EFFECT",
        "field dependence": f"{HERE}.optics:FIELD",
        "light from outside": f"{HERE}.outside:EFFECT",
        "fabrication error": f"{HERE}.optics:FABRICATION",
        "read noise": f"{HERE}.sensor:READ_NOISE",
        "shot noise": f"{HERE}.sensor:SHOT_NOISE",
        "quantisation": f"{HERE}.sensor:QUANTISATION",
        "saturation": f"{HERE}.sensor:SATURATION",
        "Bayer mosaic": f"{HERE}.sensor:MOSAIC",
        "interreflection": f"{HERE}.rendering:INTERREFLECTION",
        "dispersion of scene glass": f"{HERE}.rendering:DISPERSION",
        "render samples": f"{HERE}.rendering:SAMPLES",
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
