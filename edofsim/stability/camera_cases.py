"""PSFs and noise of a camera: whether all light is there, float32 suffices, the pupil is sampled finely
enough, and the sensor's noise has the variance that plans and restoration reckon with."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import torch
from torch import Tensor

from ..capture.sensor import SensorEffect, record, sensor_effects
from ..capture.sensor.mosaic import Mosaic
from ..optics import Camera, focus_distance, plan_sampling, psf_bank
from .case import Cameras, Case, Finding, timed
from .measures import NAN, distance
from .views import uniform

GREEN = torch.tensor([550e-9], dtype=torch.float64)
SIDE_PX = 25
ENERGY, SINGLE, FINER = 1e-6, 1e-4, 0.02
"""Largest error of a PSF's light, of float32, and of a finer pupil's PSF, relative to its brightest pixel."""
FINER_BY = 0.8
SIGMAS, SIDE = 5.0, 192
"""Standard errors that a statistic of SIDE x SIDE pixels in three channels may be off by."""
LEVELS = (0.05, 0.3, 0.6)
"""Of full scale, where no noise is clipped."""


def _psf(camera: Camera, inverse_depth: float, dtype: torch.dtype = torch.float64) -> tuple[Tensor, Tensor]:
    made = psf_bank(camera, GREEN, [inverse_depth], window_px=SIDE_PX, dtype=dtype)
    return made.values.double(), made.truncated.double()


def _light(camera: Camera, inverse_depth: float) -> float:
    """How far window and rest together are from all light, and how far below zero a pixel is."""
    values, truncated = _psf(camera, inverse_depth)
    if not bool(values.isfinite().all()):
        return NAN
    return float((values.sum((-1, -2)) + truncated - 1).abs().max() - values.min().clamp_max(0))


def _finer(camera: Camera, inverse_depth: float) -> float:
    pitch = plan_sampling(camera, GREEN, torch.tensor([inverse_depth]), SIDE_PX).pitch
    psf = camera.recipe.psf.model_copy(update={"pupil_sampling_um": FINER_BY * pitch * 1e6})
    finer = replace(camera, recipe=camera.recipe.model_copy(update={"psf": psf}))
    return distance(_psf(finer, inverse_depth)[0], _psf(camera, inverse_depth)[0])


def _psfs(cameras: Mapping[str, Camera]) -> Iterator[Finding]:
    for name, camera in cameras.items():
        focus = 1 / float(focus_distance(camera, float(GREEN)))
        for way, depth in (("infinity", 0.0), ("focus", focus), ("half the focus", 2 * focus)):
            yield timed(f"light, {way}, {name}", ENERGY, lambda c=camera, d=depth: _light(c, d))
            yield timed(
                f"float32, {way}, {name}",
                SINGLE,
                lambda c=camera, d=depth: distance(_psf(c, d, torch.float32)[0], _psf(c, d)[0]),
                alike=True,
            )
            if not camera.lens.measured:
                yield timed(
                    f"finer pupil, {way}, {name}", FINER, lambda c=camera, d=depth: _finer(c, d), alike=True
                )


def _noise(cameras: Mapping[str, Camera]) -> Iterator[Finding]:
    """Mean square of what the sensor adds, in standard errors from the variance that its effects tell."""
    for name, camera in cameras.items():
        effects = [each for each in sensor_effects(camera) if not isinstance(each, Mosaic)]
        for level in LEVELS:
            light = level * (0.9 + 0.2 * uniform(3, SIDE, SIDE))
            yield timed(
                f"variance at {level:g}, {name}", SIGMAS, lambda e=effects, light=light: _variance(light, e)
            )


def _variance(light: Tensor, effects: Sequence[SensorEffect]) -> float:
    noise = record(light, effects, 4) - light
    square = (noise - noise.mean()).square()
    predicted = sum(float(each.variance(light).mean()) for each in effects)
    return abs(float(square.mean()) - predicted) / max(float(square.std()) / square.numel() ** 0.5, 1e-30)


def cases_of(cameras: Cameras) -> tuple[Case, ...]:
    return (
        Case(
            "PSFs",
            "pupil",
            "in focus and far out of it",
            "light that is lost; phase beyond float32 or the sampling",
            "all light, as in float64, as with a finer pupil",
            lambda: _psfs(cameras()),
        ),
        Case(
            "noise",
            "sensor",
            "even light on the whole sensor",
            "a variance that plans and restoration do not know",
            "the sum of its effects' variances",
            lambda: _noise(cameras()),
        ),
    )
