"""Hard sensors: what noise, quantisation, saturation and mosaic are by definition, counted in many pixels.

A statistic of n samples may be off by `SIGMAS` of its own standard errors; errors are reported in these.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import partial

import torch
from torch import Tensor

from edofsim.capture import capture
from edofsim.capture.sensor import SensorEffect, record
from edofsim.capture.sensor.mosaic import Mosaic
from edofsim.capture.sensor.quantisation import Quantisation
from edofsim.capture.sensor.read_noise import ReadNoise
from edofsim.capture.sensor.saturation import Saturation
from edofsim.capture.sensor.shot_noise import ShotNoise
from edofsim.optics.masks.clear import ClearMask
from edofsim.render.view import View
from edofsim.stability.case import Case, Finding, timed
from edofsim.stability.views import NANOMETRES, camera_with, flat, uniform

SIGMAS = 5.0
"""Chance passes this once in two million."""
SIDE = 192
READ, FULL_WELL = 0.01, 2000.0


def _grey(level: float) -> Tensor:
    return torch.full((3, SIDE, SIDE), level, dtype=torch.float64)


def _deviation(noise: Tensor, variance: float) -> float:
    """Of the mean square from a variance, for Gaussian noise, in standard errors: sqrt(2 / n) of it."""
    return abs(float(noise.square().mean()) / variance - 1) / math.sqrt(2 / noise.numel())


def _together(one: Tensor, other: Tensor) -> float:
    """Correlation of two noises of equal size in standard errors, 1 / sqrt(n)."""
    product = (one * other).mean() / (one.std() * other.std()).clamp_min(1e-300)
    return abs(float(product)) * math.sqrt(one.numel())


def _read_noise() -> Iterator[Finding]:
    effect = (ReadNoise(deviation=READ),)
    for level in (0.0, 0.5):
        noise = record(_grey(level), effect, 4) - level
        count = noise.numel()
        yield timed(f"deviation at {level:g}", SIGMAS, lambda n=noise: _deviation(n, READ**2))
        yield timed(
            f"mean at {level:g}", SIGMAS, lambda n=noise, c=count: abs(float(n.mean())) / READ * math.sqrt(c)
        )
        below = float((noise < 0).double().mean())
        yield timed(f"half lies below {level:g}", SIGMAS, lambda b=below, c=count: 2 * abs(b - 0.5) * c**0.5)
        tails = float((noise.abs() > 2 * READ).double().mean())
        share = math.erfc(2 / math.sqrt(2))
        yield timed(
            f"beyond two deviations at {level:g}",
            SIGMAS,
            lambda t=tails, s=share, c=count: abs(t - s) / math.sqrt(s / c),
        )
        yield timed("pixels side by side", SIGMAS, lambda n=noise: _together(n[..., 1:], n[..., :-1]))
        yield timed("pixels one below the other", SIGMAS, lambda n=noise: _together(n[:, 1:], n[:, :-1]))
        yield timed("red and green", SIGMAS, lambda n=noise: _together(n[0], n[1]))
    first, same, other = (record(_grey(0.5), effect, seed) - 0.5 for seed in (4, 4, 5))
    yield timed("the same seed", 0.0, lambda: float((first - same).abs().max()), alike=True)
    yield timed("another seed", SIGMAS, lambda: _together(first, other))


def _shot_noise() -> Iterator[Finding]:
    """Counts of electrons: their variance is their mean, s / N of full scale N."""
    for level in (0.002, 0.05, 1.0, 4.0):
        found = record(_grey(level), (ShotNoise(full_well_electrons=FULL_WELL),), 4)
        variance, count = level / FULL_WELL, found.numel()
        off = (found.mean() - level).abs() / math.sqrt(variance / count)
        yield timed(f"mean at {level:g}", SIGMAS, lambda off=off: float(off))
        # of a Poisson count the fourth moment is 3 v^2 + v
        error = math.sqrt((2 + 1 / (level * FULL_WELL)) / count)
        square = float((found - level).square().mean()) / variance
        yield timed(f"variance at {level:g}", SIGMAS, lambda s=square, e=error: abs(s - 1) / e)
        whole = found * FULL_WELL
        yield timed(f"whole electrons at {level:g}", 1e-6, lambda w=whole: float((w - w.round()).abs().max()))
    yield timed(
        "none in the dark",
        0.0,
        lambda: float(record(_grey(0.0), (ShotNoise(full_well_electrons=9),), 4).max()),
    )


def _quantised() -> Iterator[Finding]:
    ramp = torch.linspace(-0.2, 1.2, 3 * SIDE * SIDE, dtype=torch.float64).reshape(3, SIDE, SIDE)
    for bits in (1, 8, 12):
        found = record(ramp, (Quantisation(bits=bits),), 0)
        steps = 2**bits - 1
        inside = (ramp >= 0) & (ramp <= 1)
        yield timed(
            f"{bits} bits, whole steps",
            1e-9,
            lambda f=found, s=steps: float((f * s - (f * s).round()).abs().max()),
        )
        yield timed(
            f"{bits} bits, half a step at most",
            0.5 + 1e-6,
            lambda f=found, s=steps, i=inside: float(((f - ramp)[i] * s).abs().max()),
        )
        yield timed(
            f"{bits} bits, all steps used", 0.0, lambda f=found, s=steps: abs(f.unique().numel() - s - 1)
        )
        yield timed(f"{bits} bits, ends", 0.0, lambda f=found: float(f.min().abs() + (f.max() - 1).abs()))


def _saturated() -> Iterator[Finding]:
    level = torch.tensor([-1.0, -1e-3, 0.0, 0.3, 1.0, 1.001, 1e12], dtype=torch.float64)
    truth = torch.tensor([0.0, 0.0, 0.0, 0.3, 1.0, 1.0, 1.0], dtype=torch.float64)
    found = record(level.expand(3, 1, -1), (Saturation(),), 0)
    yield timed("from -1 to 1e12", 0.0, lambda: float((found - truth).abs().max()))


def _mosaic() -> Iterator[Finding]:
    """Bryce Bayer's pattern: RGGB has red at even rows and columns, blue at odd ones, green elsewhere."""
    image = 0.1 + uniform(3, 6, 8)
    rows, columns = torch.arange(6)[:, None], torch.arange(8)
    places = {"RGGB": (0, 0), "BGGR": (1, 1), "GRBG": (0, 1), "GBRG": (1, 0)}
    for pattern, (row, column) in places.items():
        red = (rows % 2 == row) & (columns % 2 == column)
        blue = (rows % 2 != row) & (columns % 2 != column)
        truth = image * torch.stack([red, ~red & ~blue, blue])
        found = record(image, (Mosaic(pattern=pattern),), 0)  # pyrefly: ignore[bad-argument-type]
        yield timed(pattern, 0.0, lambda f=found, t=truth: float((f - t).abs().max()))
    noisy: tuple[SensorEffect, ...] = (Mosaic(pattern="RGGB"), ReadNoise(deviation=READ))
    seen = record(torch.zeros_like(image), noisy, 0)
    yield timed("no noise where nothing is seen", 0.0, lambda: float(seen[1, ::2, ::2].abs().max()))


def _grey_view(level: float) -> View:
    """Even light, infinitely far."""
    view = flat(0.0, rows=SIDE, columns=SIDE)
    view.radiance.fill_(level)
    return view


def _whole() -> Iterator[Finding]:
    """A camera with everything: read noise, shot noise and the steps of its converter add their variances."""
    camera = camera_with(ClearMask(), read_noise=READ, full_well_electrons=FULL_WELL, bits=8, saturation=True)
    for radiance, exposure in ((0.2, 2.0), (1.2, 0.5)):
        photo = capture(_grey_view(radiance), camera, exposure=exposure, dtype=torch.float64)
        level = radiance * exposure
        noise = photo.image - photo.clean
        variance = READ**2 + level / FULL_WELL + 1 / 255**2 / 12
        yield timed(
            f"exposure {exposure:g}, light",
            1e-6,
            lambda p=photo, s=level: float((p.clean / s - 1).abs().max()),
        )
        yield timed(
            f"exposure {exposure:g}, ideal",
            1e-6,
            lambda p=photo, s=level: float((p.ideal / s - 1).abs().max()),
        )
        yield timed(f"exposure {exposure:g}, noise", SIGMAS, partial(_deviation, noise, variance))
    dark = capture(_grey_view(0.2), camera, exposure=1e-9, dtype=torch.float64).image
    bright = capture(_grey_view(0.2), camera, exposure=50.0, dtype=torch.float64).image
    yield timed("nothing below 0", 0.0, lambda: float((-dark.min()).clamp_min(0)))
    yield timed("full is full", 0.0, lambda: float((bright - 1).abs().max()))
    pair = capture([_grey_view(0.5)] * 2, camera, exposure=1.0, dtype=torch.float64)
    noise = pair.image - pair.clean
    yield timed("two photos of a batch", SIGMAS, lambda: _together(noise[0], noise[1]))


def _response() -> Iterator[Finding]:
    """Light of one band in a channel is what the response's table says there, as a share of all bands."""
    from .written_out import sensor_response

    shares = torch.from_numpy(sensor_response(NANOMETRES))
    camera = camera_with(ClearMask())
    for band, nm in enumerate(NANOMETRES):
        view = flat(0.0)
        view.radiance.zero_()
        view.radiance[band] = 1.0
        photo = capture(view, camera, exposure=1.0, dtype=torch.float64)
        yield timed(
            f"{nm:g} nm",
            1e-9,
            lambda p=photo, b=band: float((p.ideal.mean((1, 2)) - shares[:, b]).abs().max()),
        )


def _case(name: str, physics: str, risk: str, expected: str, check: Callable[[], Iterator[Finding]]) -> Case:
    return Case(name, "sensor", physics, risk, expected, check)


CASES: tuple[Case, ...] = (
    _case(
        "read noise",
        "110,592 pixels, in the dark and in the light",
        "clipped, correlated, of another scale",
        "Gaussian, the same everywhere, of its own in each pixel",
        _read_noise,
    ),
    _case("shot noise", "4 to 8000 electrons", "a variance that is not the mean", "Poisson's", _shot_noise),
    _case(
        "quantisation", "1, 8 and 12 bits", "a step too many or too few", "to the nearest step", _quantised
    ),
    _case("saturation", "from -1 to 1e12", "wrap-around", "0 to 1", _saturated),
    _case("mosaic", "all four patterns", "rows and columns exchanged", "Bayer's", _mosaic),
    _case("all of a sensor", "every effect at once", "an effect twice, or never", "variances add up", _whole),
    _case("response", "light of one band", "colours exchanged", "the table's shares", _response),
)
