"""PSFs against closed forms and against the same Fourier integral by another rule.

Bounds are as in `pupils`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial

import torch
from torch import Tensor

from edofsim.optics import Camera, PsfField, psf_bank
from edofsim.optics.masks import catalogue
from edofsim.optics.masks.clear import ClearMask
from edofsim.optics.masks.cubic import CubicMask
from edofsim.stability.case import Case, Finding, timed
from edofsim.stability.measures import distance

from . import written_out
from .pupils import GREEN, PRECISIONS, SIDE, bank, camera_of, name_of, whole

WRITTEN_OUT = 6e-3
"""Of the brightest pixel: 3.5e-3 were seen, in the rings of the widest blur."""
FAINT = 0.05


def _faint(values: Tensor, truth: Tensor) -> float:
    """Of the light in pixels below 0.5 % of the brightest, how much is elsewhere."""
    faint = truth < 0.005 * truth.max()
    held = truth[faint].sum()
    return float((values - truth)[faint].abs().sum() / held) if float(held) > 0 else 0.0


def _written_out() -> Iterator[Finding]:
    """The paper's aperture: the same Fourier integral by another rule (`written_out`)."""
    pupils = {
        "clear": (ClearMask(), written_out.Pupil(2.5e-3, order=128)),
        "cubic": (CubicMask(alpha_rad=30.0), written_out.cubic(2.5e-3, 30.0, 128)),
    }
    for name, (mask, pupil) in pupils.items():
        camera = camera_of(2.5, mask, oversampling=4)
        for nm in (450.0, 543.0, 650.0):
            psfs = written_out.Psfs(pupil, nm * 1e-9, SIDE, 8)
            for depth in (0.0, 2 / 3, 2.0):
                truth = torch.from_numpy(psfs.at([depth])[0])
                for dtype in PRECISIONS:
                    made = partial(psf_bank, camera, [nm * 1e-9], [depth], window_px=SIDE, dtype=dtype)
                    yield timed(
                        f"{name}, {nm:g} nm, {depth:.3g} /m, {name_of(dtype)}",
                        WRITTEN_OUT,
                        lambda m=made, t=truth: distance(m().values[0, 0].double(), t),
                    )
                way = f"{name}, {nm:g} nm, {depth:.3g} /m, faint pixels"
                yield timed(way, FAINT, lambda m=made, t=truth: _faint(m().values[0, 0].double(), t))


def _every_mask() -> Iterator[Finding]:
    """All kinds of mask as they are by default, in focus and far out of it."""
    for entry in catalogue():
        camera = camera_of(2.5, entry.example, oversampling=4)
        for depth in (0.7, 2.0):
            found: list[PsfField] = []

            def energy(c: Camera = camera, d: float = depth, found: list[PsfField] = found) -> float:
                found.append(bank(c, d))
                return whole(found[0])

            def single(c: Camera = camera, d: float = depth, found: list[PsfField] = found) -> float:
                return distance(bank(c, d, torch.float32).values.double(), found[0].values)

            yield timed(f"{entry.kind}, {depth:g} /m, float64", 1e-6, energy)
            yield timed(f"{entry.kind}, {depth:g} /m, float32", 1e-4, single)


def _pinhole() -> Iterator[Finding]:
    """An aperture narrower than the paper's pupil sample: Airy's pattern, A / (lambda z_i)^2 [2 J1(x) / x]^2
    times a pixel, x = 2 pi r rho / (lambda z_i). It is so wide that the window sees its top."""
    camera = camera_of(0.01)
    wave = float(GREEN) * camera.sensor_distance
    at = (torch.arange(SIDE, dtype=torch.float64) - SIDE // 2) * camera.pixel
    x = 2 * math.pi * camera.aperture_radius / wave * torch.hypot(at[:, None], at).clamp_min(1e-12)
    top = math.pi * camera.aperture_radius**2 / wave**2 * camera.pixel**2
    truth = top * (2 * torch.special.bessel_j1(x) / x).square()
    for dtype in PRECISIONS:
        made = partial(bank, camera, 0.5, dtype)
        yield timed(f"{name_of(dtype)}", 1e-3, lambda m=made: distance(m().values[0, 0].double(), truth))


def _grids() -> Iterator[Finding]:
    """128 and 129 samples across the pupil against 500."""
    truth = bank(camera_of(0.6, CubicMask(alpha_rad=6.0), pupil_um=2.4), 0.3).values
    for samples in (128, 129):
        made = partial(bank, camera_of(0.6, CubicMask(alpha_rad=6.0), pupil_um=1200 / samples), 0.3)
        yield timed(f"{samples} samples, float64", 2e-3, lambda m=made: distance(m().values, truth))


CASES: tuple[Case, ...] = (
    Case(
        "the paper's aperture",
        "pupil",
        "clear and cubic, three wavelengths, infinity to half a metre",
        "any of a hundred signs and factors",
        "the same integral by Gauss' rule",
        _written_out,
    ),
    Case(
        "every kind of mask",
        "pupil",
        "all masks of the catalogue, in focus and far out of it",
        "fractional powers, hard edges",
        "all light, float32 as float64",
        _every_mask,
    ),
    Case(
        "a pupil of one sample",
        "pupil",
        "an aperture of 20 um",
        "a grid of one sample",
        "Airy's pattern",
        _pinhole,
    ),
    Case(
        "grids odd and even",
        "pupil",
        "128 and 129 samples across the pupil",
        "half a sample",
        "the PSF of a finer grid",
        _grids,
    ),
)
