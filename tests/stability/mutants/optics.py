"""Broken optics."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import AbstractContextManager

import torch
from torch import Tensor

from edofsim.optics import Camera, camera, psf, pupil, transform
from edofsim.optics.lenses import Lens
from edofsim.optics.lenses.plano_convex import PlanoConvexLens
from edofsim.optics.transform import SensorWindow
from edofsim.recipe.camera import CameraRecipe

from .mutant import Mutant, after, scaled, swapped, together

PSFS = ("depth", "pupil")
BOTH = ("depth", "coverage", "pupil")


def _psfs(change: Callable[[Tensor], Tensor]) -> Callable[[], AbstractContextManager[object]]:
    """Every PSF changed, [depth, .., y, x], with gradients or without."""
    return lambda: together(after(psf, "energies", change), after(psf, "propagate", change))


def _bases(reach: float) -> AbstractContextManager[object]:
    inner = psf.make_bases

    def make(grid: object, window: object, at: float, *more: object) -> object:
        return inner(grid, window, at * reach, *more)  # pyrefly: ignore

    return swapped(psf, "make_bases", make)


def _aperture(times: float) -> AbstractContextManager[object]:
    def radius(lens: PlanoConvexLens) -> float:
        return lens.aperture_radius_mm * 1e-3 * times

    return swapped(PlanoConvexLens, "aperture_radius", property(radius))


def _focus(times: float) -> AbstractContextManager[object]:
    inner = camera._sensor_distance

    def other(recipe: CameraRecipe, lens: Lens, problems: list[str]) -> float:
        focus = recipe.focus.model_copy(update={"distance_m": recipe.focus.distance_m * times})
        return inner(recipe.model_copy(update={"focus": focus}), lens, problems)

    return swapped(camera, "_sensor_distance", other)


def _focal_length_of_one_line() -> AbstractContextManager[object]:
    inner = PlanoConvexLens.focal_length

    def green(lens: PlanoConvexLens, wavelengths: Tensor | float) -> Tensor:
        return inner(lens, torch.full_like(torch.as_tensor(wavelengths, dtype=torch.float64), 550e-9))

    return swapped(PlanoConvexLens, "focal_length", green)


def _delay(line: float | None, less: float) -> AbstractContextManager[object]:
    """The mask's delay with the index at `line` [m] (None for each wavelength's own) minus `less`."""

    def delay(seen_by: Camera, wavelength: float) -> float:
        index = float(seen_by.mask_material.index(wavelength if line is None else line))
        return 2 * math.pi / wavelength * (index - less)

    return swapped(pupil, "mask_delay", delay)


def _one_sample(window: SensorWindow) -> Tensor:
    """Each pixel as large as its middle sample says."""
    count, over = window.symmetric_pixels, window.oversampling
    weights = torch.zeros(count, window.sub_pixels, dtype=torch.float64)
    for pixel in range(count):
        weights[pixel, 1 + pixel * over + over // 2] = over
    return weights


def _pixel(times: float) -> AbstractContextManager[object]:
    def window(pixels: int, pitch: float, oversampling: int) -> SensorWindow:
        return SensorWindow(pixels, pitch * times, oversampling)

    return swapped(psf, "SensorWindow", window)


def _flat(lens: PlanoConvexLens, square: Tensor) -> Tensor:
    return square * 0


def _upside_down(height_map: Tensor | None) -> Tensor | None:
    return None if height_map is None else height_map.flip(0)


def _ragged(found: tuple[Tensor, Tensor]) -> tuple[Tensor, Tensor]:
    return (found[0] > 0.5).double(), found[1]


def _reduced_late(phase: Tensor) -> Tensor:
    return torch.remainder(phase.float() + math.pi, 2 * math.pi) - math.pi


MUTANTS: tuple[Mutant, ...] = (
    Mutant("PSF transposed", "rows and columns of every PSF change places", PSFS, _psfs(lambda x: x.mT)),
    Mutant("PSF turned", "every PSF by half a turn", PSFS, _psfs(lambda x: x.flip(-1, -2))),
    Mutant("PSF one pixel off", "every PSF one pixel to the right", BOTH, _psfs(lambda x: x.roll(1, -1))),
    Mutant("energy 1 % up", "PSFs hold 1 % too much light", BOTH, _psfs(lambda x: 1.01 * x)),
    Mutant("energy 1 % down", "PSFs hold 1 % too little light", BOTH, _psfs(lambda x: 0.99 * x)),
    Mutant(
        "window renormalised",
        "what leaves a PSF's window is put back into it",
        ("depth", "coverage", "radiance", "pupil"),
        _psfs(lambda x: x / x.sum((-1, -2), keepdim=True)),
    ),
    Mutant(
        "faint tails cut",
        "values of a PSF below 0.5 % of its brightest are 0",
        ("radiance", "pupil"),
        _psfs(lambda x: torch.where(x < 0.005 * x.amax((-1, -2), keepdim=True), 0.0, x)),
    ),
    Mutant("PSF in bfloat16", "PSFs keep three digits", BOTH, _psfs(lambda x: x.bfloat16().to(x))),
    Mutant(
        "defocus of the wrong sign",
        "near and far change places",
        BOTH,
        lambda: scaled(psf, "defocus", -1.0),
    ),
    Mutant(
        "defocus 1 % up",
        "Psi is 1 % too large",
        ("pupil",),
        lambda: scaled(psf, "defocus", 1.01),
    ),
    Mutant("no defocus", "every depth is in focus", BOTH, lambda: scaled(psf, "defocus", 0.0)),
    Mutant(
        "lens without dispersion",
        "all wavelengths have the focal length of 550 nm",
        ("depth", "spectrum", "pupil"),
        _focal_length_of_one_line,
    ),
    Mutant(
        "mask without dispersion", "the resist's index is that at 543 nm", PSFS, lambda: _delay(543e-9, 1.0)
    ),
    Mutant("mask in no air", "a height delays by n, not by n - 1", PSFS, lambda: _delay(None, 0.0)),
    Mutant("no mask", "the relief is left out", PSFS, lambda: scaled(pupil, "mask_delay", 0.0)),
    Mutant(
        "mask upside down",
        "rows of the relief in reverse",
        PSFS,
        lambda: after(pupil, "surface", _upside_down),
    ),
    Mutant(
        "no spherical aberration",
        "the lens is a parabola",
        ("pupil",),
        lambda: swapped(PlanoConvexLens, "_sag", _flat),
    ),
    Mutant("pixels 1 % wider", "the sensor's pitch is 1 % too large", PSFS, lambda: _pixel(1.01)),
    Mutant("aperture 1 % wider", "the pupil's radius is 1 % too large", PSFS, lambda: _aperture(1.01)),
    Mutant("focus 1 % farther", "the sensor stands for 1.515 m", ("pupil",), lambda: _focus(1.01)),
    Mutant("wavelength 1 % longer", "in the transform to the sensor", PSFS, lambda: _bases(1.01)),
    Mutant(
        "pixels as points",
        "a pixel shows what its middle sees",
        PSFS,
        lambda: swapped(transform, "pixel_weights", _one_sample),
    ),
    Mutant(
        "ragged aperture",
        "cells at its edge are open or shut",
        PSFS,
        lambda: after(pupil, "mask_amplitude", _ragged),
    ),
    Mutant(
        "phase in float32",
        "before whole waves are taken off",
        ("pupil",),
        lambda: swapped(pupil, "_reduced", _reduced_late),
    ),
)
