"""What lens, mask and pixels do to PSFs, each to be left out or not; and how PSFs change over the frame."""

from __future__ import annotations

from collections.abc import Callable

from ...core.words import metres
from ...optics import best_focus_distance, focus_distance
from ...optics.camera import cutoff_frequency
from ...optics.field import STEPS
from ..effect import Effect, Level
from ..facts import Facts


def _effect(
    name: str,
    left_out: Callable[[Facts], Level],
    full: Callable[[Facts], str],
    why: Callable[[Facts], str],
    absent: Callable[[Facts], str] = lambda facts: "",
) -> Effect:
    return Effect(name, lambda facts: [left_out(facts), Level(full(facts), {})], why, absent, stage="psf")


def _aberration(facts: Facts) -> str:
    wavelength = float(facts.view.wavelengths.double().mean())
    waves = facts.camera.lens.waves_at_most(wavelength)
    paraxial = float(focus_distance(facts.camera, wavelength))
    best = best_focus_distance(facts.camera, wavelength)
    return (
        f"the wave of the lens departs from a parabola's by {waves:.2g} waves within the aperture, whose"
        f" best focus is at {metres(1 / best)}, near the axis at {metres(1 / paraxial)}"
    )


SPHERICAL_ABERRATION = _effect(
    "spherical aberration",
    lambda facts: Level("parabola", {"spherical_aberration": False}),
    lambda facts: "the lens's own",
    _aberration,
    lambda facts: "" if facts.camera.lens.aberrates else "the lens has none",
)


def _one_band(facts: Facts) -> str:
    return "the view holds one band" if facts.view.bands == 1 else ""


def _powers(facts: Facts) -> str:
    first, last = (
        1 / float(facts.camera.lens.focal_length(float(w))) for w in facts.view.wavelengths[[0, -1]]
    )
    return f"the lens's power changes by {first - last:.2f} dioptres from {facts.nm()}"


LENS_DISPERSION = _effect(
    "dispersion of the lens",
    lambda facts: Level(
        f"refracts as at {facts.camera.recipe.focus.wavelength_nm:g} nm", {"lens_dispersion": False}
    ),
    lambda facts: "each wavelength",
    _powers,
    lambda facts: (
        _one_band(facts) if facts.camera.lens.disperses else "the lens refracts all wavelengths alike"
    ),
)


def _no_height_map(facts: Facts) -> str:
    has_height = facts.camera.height_map is not None or hasattr(
        facts.camera.recipe.mask, "design_wavelength_nm"
    )
    return _one_band(facts) if has_height else "the mask has no height map"


def _indices(facts: Facts) -> str:
    material = facts.camera.mask_material
    first, last = (float(material.index(float(w))) for w in facts.view.wavelengths[[0, -1]])
    return f"{material.name} has the index {first:.3f} to {last:.3f} over {facts.nm()}"


DOE_DISPERSION = _effect(
    "dispersion of the DOE",
    lambda facts: Level("refracts the same", {"doe_dispersion": False}),
    lambda facts: "each wavelength",
    _indices,
    _no_height_map,
)


def _as_designed(facts: Facts) -> str:
    made = facts.camera.recipe.fabrication
    return "the recipe says nothing of how the mask is made" if made is None else ""


def _made(facts: Facts) -> str:
    made = facts.camera.recipe.fabrication
    if made is None:
        return _as_designed(facts)
    return f"height errors of {made.height_noise_nm:g} nm scatter light; {made.levels or 'no'} grey levels"


FABRICATION = _effect(
    "fabrication error",
    lambda facts: Level("as designed", {"fabrication": False}),
    lambda facts: "as made",
    _made,
    _as_designed,
)


def _cutoff(facts: Facts) -> str:
    ratio = 2 * facts.camera.pixel * cutoff_frequency(facts.camera, float(facts.view.wavelengths.min()))
    return f"the optics pass frequencies up to {ratio:.1f} times what the pixels can tell"


# one sample a pixel is right on average over many wavelengths, and wrong with the few of gathered bands
PIXEL = _effect(
    "pixel integration",
    lambda facts: Level("1 sample a pixel", {"oversampling": 1}, allowed=False),
    lambda facts: f"{facts.full.oversampling} x {facts.full.oversampling} samples",
    _cutoff,
)

FIELD = Effect(
    "field dependence",
    lambda facts: [
        Level("that of the axis", {"field_step_px": 0}),
        *(Level(f"every {step} px", {"field_step_px": step}) for step in STEPS),
        Level("as fine as depth layers", {}),
    ],
    lambda facts: "aberrations, vignetting and illumination of the lens change with the place in the frame",
    lambda facts: "" if facts.camera.lens.varies else "the lens has the same PSF all over the frame",
    error=lambda facts, level: facts.without_places(level.change["field_step_px"]),
    added="noise",
    stage="psf",
)
