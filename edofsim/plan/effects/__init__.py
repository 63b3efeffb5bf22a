"""The effects that a plan decides on, each in a file. To add one: a file, and a line in `EFFECTS`."""

from ..effect import Effect
from . import (
    bands,
    bounces,
    depth_layers,
    doe_dispersion,
    exact_lens,
    fabrication,
    hero,
    hidden,
    lens_dispersion,
    mosaic,
    occlusion,
    outside,
    pixel,
    pupil,
    pupil_parts,
    quantisation,
    rank,
    read_noise,
    samples,
    saturation,
    shot_noise,
    window,
)

EFFECTS: tuple[Effect, ...] = (
    bands.EFFECT,
    depth_layers.EFFECT,
    occlusion.EFFECT,
    hidden.EFFECT,
    pupil_parts.EFFECT,
    exact_lens.EFFECT,
    lens_dispersion.EFFECT,
    doe_dispersion.EFFECT,
    pixel.EFFECT,
    window.EFFECT,
    pupil.EFFECT,
    rank.EFFECT,
    outside.EFFECT,
    fabrication.EFFECT,
    read_noise.EFFECT,
    shot_noise.EFFECT,
    quantisation.EFFECT,
    saturation.EFFECT,
    mosaic.EFFECT,
    bounces.EFFECT,
    hero.EFFECT,
    samples.EFFECT,
)

__all__ = ["EFFECTS"]
