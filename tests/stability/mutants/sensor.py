"""Broken sensors."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager

import torch
from torch import Generator, Tensor

from edofsim.capture import photograph
from edofsim.capture.sensor import SensorEffect, Signal
from edofsim.capture.sensor import mosaic as bayer
from edofsim.capture.sensor.quantisation import Quantisation
from edofsim.capture.sensor.read_noise import ReadNoise
from edofsim.capture.sensor.saturation import Saturation
from edofsim.capture.sensor.shot_noise import ShotNoise

from .mutant import Mutant, after, swapped

SENSOR = ("sensor",)


def _noise(
    make: Callable[[Tensor, float, Generator], Tensor],
) -> Callable[[], AbstractContextManager[object]]:
    """Read noise made otherwise, of an image, a deviation and a generator."""

    def act(effect: ReadNoise, signal: Signal, generator: Generator) -> Signal:
        noise = make(signal.image, effect.deviation, generator)
        return Signal(signal.image + (noise if signal.seen is None else noise * signal.seen), signal.seen)

    return lambda: swapped(ReadNoise, "act", act)


def _gauss(shape: tuple[int, ...], generator: Generator) -> Tensor:
    return torch.randn(shape, generator=generator, dtype=torch.float64)


def _steps(
    count: Callable[[int], float], rounding: Callable[[Tensor], Tensor]
) -> Callable[[], AbstractContextManager[object]]:
    def act(effect: Quantisation, signal: Signal, generator: Generator) -> Signal:
        steps = count(effect.bits)
        return Signal(rounding(signal.image.clamp(0, 1) * steps) / steps, signal.seen)

    return lambda: swapped(Quantisation, "act", act)


def _shot(times: float, poisson: bool = True) -> Callable[[], AbstractContextManager[object]]:
    def act(effect: ShotNoise, signal: Signal, generator: Generator) -> Signal:
        full = effect.full_well_electrons * times
        image = signal.image.detach().double().clamp_min(0)
        if poisson:
            return Signal(torch.poisson(image * full, generator=generator) / full, signal.seen)
        noise = torch.randn(image.shape, generator=generator, dtype=torch.float64)
        return Signal(image + noise * (0.5 / full) ** 0.5, signal.seen)

    return lambda: swapped(ShotNoise, "act", act)


def _same(effect: SensorEffect, signal: Signal, generator: Generator) -> Signal:
    return signal


def _one_seed() -> AbstractContextManager[object]:
    inner = photograph.record

    def recorded(clean: Tensor, effects: Sequence[SensorEffect], seed: int) -> Tensor:
        return inner(clean, effects, 0)

    return swapped(photograph, "record", recorded)


def _effects(
    change: Callable[[tuple[SensorEffect, ...]], tuple[SensorEffect, ...]],
) -> Callable[[], AbstractContextManager[object]]:
    return lambda: after(photograph, "sensor_effects", change)


def _a_row_off(seen: Tensor) -> Tensor:
    return seen.roll(1, -2)


def _exchanged(seen: Tensor) -> Tensor:
    return seen.flip(0)


def _noise_shape(x: Tensor) -> tuple[int, ...]:
    return tuple(x.shape)


MUTANTS: tuple[Mutant, ...] = (
    Mutant(
        "read noise 10 % up",
        "its deviation",
        SENSOR,
        _noise(lambda x, d, g: 1.1 * d * _gauss(_noise_shape(x), g)),
    ),
    Mutant(
        "read noise 2 % down",
        "its deviation",
        SENSOR,
        _noise(lambda x, d, g: 0.98 * d * _gauss(_noise_shape(x), g)),
    ),
    Mutant("no read noise", "the photo is clean", SENSOR, lambda: swapped(ReadNoise, "act", _same)),
    Mutant(
        "one noise for all pixels",
        "drawn once",
        SENSOR,
        _noise(lambda x, d, g: (d * _gauss((1,), g)).expand(x.shape)),
    ),
    Mutant(
        "one noise for all channels",
        "drawn once a pixel",
        SENSOR,
        _noise(lambda x, d, g: (d * _gauss(_noise_shape(x[:1]), g)).expand(x.shape)),
    ),
    Mutant(
        "one noise a row",
        "drawn once for each",
        SENSOR,
        _noise(lambda x, d, g: (d * _gauss((*x.shape[:-1], 1), g)).expand(x.shape)),
    ),
    Mutant(
        "even noise",
        "read noise is uniform, of the same deviation",
        SENSOR,
        _noise(lambda x, d, g: d * 12**0.5 * (torch.rand(x.shape, generator=g, dtype=torch.float64) - 0.5)),
    ),
    Mutant(
        "noise clipped in the dark",
        "nothing is below 0",
        SENSOR,
        _noise(lambda x, d, g: (x + d * _gauss(_noise_shape(x), g)).clamp_min(0) - x),
    ),
    Mutant(
        "noise by light",
        "read noise grows with the signal",
        SENSOR,
        _noise(lambda x, d, g: 2 * x * d * _gauss(_noise_shape(x), g)),
    ),
    Mutant("one seed for all", "every photo has the noise of seed 0", SENSOR, _one_seed),
    Mutant("shot noise 10 % up", "fewer electrons", SENSOR, _shot(1 / 1.21)),
    Mutant("shot noise as read noise", "the same at every brightness", SENSOR, _shot(1.0, poisson=False)),
    Mutant("no shot noise", "light comes in no electrons", SENSOR, lambda: swapped(ShotNoise, "act", _same)),
    Mutant(
        "a bit fewer", "of the converter", SENSOR, _steps(lambda bits: 2 ** (bits - 1) - 1 or 1, torch.round)
    ),
    Mutant("a bit more", "of the converter", SENSOR, _steps(lambda bits: 2 ** (bits + 1) - 1, torch.round)),
    Mutant(
        "a step too many", "2^bits in place of 2^bits - 1", SENSOR, _steps(lambda bits: 2**bits, torch.round)
    ),
    Mutant(
        "steps cut off",
        "down in place of to the nearest",
        SENSOR,
        _steps(lambda bits: 2**bits - 1, torch.floor),
    ),
    Mutant("no saturation", "a full pixel goes on", SENSOR, lambda: swapped(Saturation, "act", _same)),
    Mutant(
        "mosaic a row off",
        "the pattern begins with its second row",
        SENSOR,
        lambda: after(bayer, "mosaic", _a_row_off),
    ),
    Mutant("mosaic transposed", "of odd and even", SENSOR, lambda: after(bayer, "mosaic", _exchanged)),
    Mutant(
        "effects in reverse",
        "the converter comes before the noise",
        SENSOR,
        _effects(lambda effects: effects[::-1]),
    ),
    Mutant("effects left out", "the sensor shows the clean image", SENSOR, _effects(lambda effects: ())),
)
