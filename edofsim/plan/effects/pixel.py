"""Pixel integration: a pixel gathers light over its area."""

from __future__ import annotations

from ..effect import Effect, Level
from ..facts import Facts


def levels(facts: Facts) -> list[Level]:
    finest = facts.full.oversampling
    # one sample a pixel is right on average over many wavelengths, and wrong with the few of gathered bands
    once = Level("1 sample a pixel", {"oversampling": 1}, allowed=False)
    return [once, Level(f"{finest} x {finest} samples", {})]


def why(facts: Facts) -> str:
    cutoff = 2 * facts.camera.aperture_radius / facts.camera.sensor_distance
    ratio = cutoff / float(facts.view.wavelengths.min()) * 2 * facts.camera.pixel
    return f"the optics pass frequencies up to {ratio:.1f} times what the pixels can tell"


EFFECT = Effect(
    "pixel integration",
    levels,
    why,
    stage="psf",
)
