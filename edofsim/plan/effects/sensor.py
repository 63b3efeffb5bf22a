"""Noise, quantisation, saturation and the mosaic of the sensor: what they change is known without a look at
PSFs, and no photo takes longer for them."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache

import torch

from ...capture.sensor import SensorEffect, Signal
from ...recipe.camera import Sensor
from ..effect import Effect, Errors, Level
from ..facts import Facts, rms


def _of(facts: Facts) -> Sensor:
    return facts.camera.recipe.sensor


def _effect(
    name: str,
    field: str,
    full: Callable[[Sensor], str],
    why: Callable[[Facts], str],
    absent: Callable[[Facts], str],
    error: Callable[[Facts], Errors],
    left_out: str = "none",
) -> Effect:
    return Effect(
        name,
        lambda facts: [Level(left_out, {field: False}), Level(full(_of(facts)), {})],
        why,
        absent,
        error=lambda facts, level: error(facts),
        added="noise",
        stage="sensor",
    )


READ_NOISE = _effect(
    "read noise",
    "read_noise",
    lambda sensor: "Gaussian",
    lambda facts: f"the recipe asks for {facts.camera.read_noise:g} of full scale",
    lambda facts: "" if facts.camera.read_noise else "the recipe asks for none",
    lambda facts: (facts.camera.read_noise,) * len(facts.response),
)


def _shot_noise(facts: Facts) -> Errors:
    """Its variance is the signal over the full well: the mean signal gives the mean square."""
    return tuple((facts.levels_of_light / (_of(facts).full_well_electrons or math.inf)).sqrt().tolist())


SHOT_NOISE = _effect(
    "shot noise",
    "shot_noise",
    lambda sensor: "Poisson",
    lambda facts: f"full scale is {_of(facts).full_well_electrons:g} electrons",
    lambda facts: "" if _of(facts).full_well_electrons else "the recipe names no full well",
    _shot_noise,
)


def _quantisation(facts: Facts) -> Errors:
    """Rounding to steps of q errs by q / sqrt(12)."""
    return (1 / (2 ** (_of(facts).bits or 1) - 1) / 12**0.5,) * len(facts.response)


QUANTISATION = _effect(
    "quantisation",
    "quantisation",
    lambda sensor: f"{sensor.bits} bits",
    lambda facts: f"the converter has {_of(facts).bits} bits",
    lambda facts: "" if _of(facts).bits else "the recipe names no number of bits",
    _quantisation,
)


def _unsaturated(facts: Facts) -> str:
    clips = ", but the converter clips" if _of(facts).bits else ""
    return "" if _of(facts).saturation else f"the recipe asks for none{clips}"


def _full_pixels(facts: Facts) -> str:
    share = float((facts.blurred > 1).any(0).double().mean())
    return f"{share:.2%} of the pixels see more light than they hold"


def _saturation(facts: Facts) -> Errors:
    """What the photo holds beyond black and full scale."""
    photo = facts.blurred
    return rms((photo - photo.clamp(0, 1)) / photo.shape[1] ** 0.5)


SATURATION = _effect(
    "saturation", "saturation", lambda sensor: "at full scale", _full_pixels, _unsaturated, _saturation
)


def _mosaic(facts: Facts) -> Errors:
    """The light that the mosaic keeps out: that of three pixels in four, of green in two."""
    photo, pattern = facts.blurred, _of(facts).bayer or "RGB"
    lost = photo.new_tensor([1 - pattern.count(colour) / 4 for colour in "RGB"])
    return rms(photo * (lost[:, None] / photo.shape[1]).sqrt())


MOSAIC = _effect(
    "Bayer mosaic",
    "mosaic",
    lambda sensor: sensor.bayer or "none",
    lambda facts: f"the sensor's pixels are {_of(facts).bayer}",
    lambda facts: "" if _of(facts).bayer else "every pixel sees every channel",
    _mosaic,
    left_out="every channel in every pixel",
)


@cache
def of_kind(kind: str) -> Effect:
    """The effect of a plan for one of the sensor's of another package: what it makes of the photo."""

    def listed(facts: Facts) -> list[SensorEffect]:
        every = _of(facts).effects
        return [each for each in every if each.kind == kind and isinstance(each, SensorEffect)]

    def error(facts: Facts, level: Level) -> Errors:
        photo = facts.blurred
        signal = Signal(photo[:, :, None])
        generator = torch.Generator().manual_seed(0)
        for effect in listed(facts):
            signal = effect.act(signal, generator)
        return rms((signal.image[:, :, 0] - photo) / photo.shape[1] ** 0.5)

    return Effect(
        kind,
        lambda facts: [Level("none", {"without_sensor": (kind,)}), Level("as the recipe says", {})],
        lambda facts: "the recipe lists it among the sensor's effects",
        lambda facts: "" if listed(facts) else "the recipe lists none",
        error=error,
        added="noise",
        stage="sensor",
    )
