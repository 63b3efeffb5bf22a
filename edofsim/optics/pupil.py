"""The generalised pupil function: what the lens, its mask and a point's distance do to a wave.

Akpinar et al., Eq. `Q`: Q = A exp(j Phi) exp(j Psi rho^2). It is kept in two factors, because only the second
depends on depth and that one is separable: the `pupil_function` without defocus, and the `chirp`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache, reduce

import torch
from torch import Tensor

from ..errors import InputError
from .camera import Camera
from .fabrication import wave_height
from .grid import NO_WRAPS, PupilGrid, disc_amplitude, disc_coverage, resample, sampled_at
from .height import design_phase_to_height, design_wavelength, designed_map, nearest_known, surface
from .lenses.base import Bend
from .mask_surface import MaskSurface
from .masks import Mask, asked, mask_amplitude

TRANSMISSION_GRID = PupilGrid(514, 2 / 512, 1.0)
"""Of a pupil of radius 1, for the light that a mask lets through."""


SLOPE_SAMPLES = 258
"""Across the pupil, for the slopes of a mask."""
MISPLACED_WAVES = 0.05
"""By which light may miss its path behind a mask in the stop."""
Regions = list[tuple[Tensor, Tensor | float | None]]
"""Amplitude and height of each part of an aperture."""


class StrongMask(InputError):
    """A mask that bends rays too much for its height map to be added to those that go straight on."""


@dataclass(frozen=True)
class Aperture:
    """What stands in the pupil, for all wavelengths.

    lens: phase [rad] at a wavelength [m] that the lens adds to its parabola, float64 [samples, samples]; the
        parabola cancels against propagation and the incoming wave, and what is left of it is Psi (`defocus`).
    bend: what of defocus is no parabola (`Lens.bend`).
    regions: amplitude (same shape) and height of the mask in metres, a map or the same everywhere; the wave
        is the sum over regions.
    light: all light that is let through, counted in cells of the grid.
    transmission: as a fraction of what the open aperture lets through.
    """

    grid: PupilGrid
    lens: Callable[[float], Tensor]
    bend: Bend | None
    regions: tuple[tuple[Tensor, Tensor | float | None], ...]
    light: float
    transmission: float


def aperture(camera: Camera, grid: PupilGrid, seed: int | None = None) -> Aperture:
    """The camera's aperture and mask on a grid, with grey edges; `seed` as in `surface`.

    Raises InputError for a mask that lets no light through or is too strong for a lens of surfaces, and for a
    lens that is known by its PSFs alone.
    """
    if camera.lens.measured:
        raise InputError(
            f"the lens of {camera.recipe.name} is known by measured PSFs: nothing is known of its pupil, so"
            " that this cannot be computed (sub-apertures, Strehl ratios, reference by its pupil)"
        )
    mask = camera.mask
    amplitude, light = mask_amplitude(mask, grid)
    regions: list[tuple[Tensor, Tensor | float | None]] = []
    if camera.height_map is None and camera.recipe.fabrication is None:
        levels = asked(mask, "regions", lambda: mask.regions(grid))
        regions = [(part, design_phase_to_height(camera, phase)) for part, phase in levels]
    if not regions:
        regions = [(amplitude, surface(camera, grid, seed))]
    if camera.amplitude is not None:
        own = _own_amplitude(camera.amplitude, grid)
        regions = [(part * own, height) for part, height in regions]
        light = light * own.square()
    lens = camera.lens.phases(grid.radius_squared())
    seen_from = ""
    right, up = grid.centres[None, :], grid.centres.flip(0)[:, None]
    if camera.lens.varies:
        refuse_strong(camera)
        regions, light = _in_stop(camera, grid, regions, light)
        share = camera.lens.field_open(right, up, camera.field)
        regions = [(part * share.sqrt(), heights) for part, heights in regions]
        light, round_one = light * share, lens
        seen_from = f" seen from the field {camera.field}"

        def lens(wavelength: float) -> Tensor:
            return round_one(wavelength) + camera.lens.field_phase(right, up, wavelength, camera.field)

    shone = light.sum()
    total, whole = float(shone.detach()), float(disc_coverage(grid, grid.radius).sum())
    if not total > 0:
        raise InputError(
            f"the mask ({mask.kind}) lets no light through the {grid.samples} x {grid.samples} samples of "
            f"the pupil{seen_from}; open it wider"
        )
    bend = camera.lens.bend(right, up, camera.field)
    if shone.requires_grad:  # PSFs are parts of the light, which learns, too
        regions = [(part * (total / shone).sqrt(), height) for part, height in regions]
    return Aperture(grid, lens, bend, tuple(regions), total, total / whole)


def refuse_strong(camera: Camera) -> None:
    """Raise StrongMask where the mask bends rays so much that the rest of the lens adds another path to them:
    the mask's own is added where they cross the stop as if it did not bend them. Masks in training are not
    looked at, nor are stepped ones, whose levels are flat."""
    maps = camera.height_map, camera.amplitude
    if not camera.lens.varies or any(each is not None and each.requires_grad for each in maps):
        return
    plain = replace(camera, recipe=camera.recipe.model_copy(update={"fabrication": None}))
    radius, given = camera.aperture_radius, designed_map(camera)
    samples = max(SLOPE_SAMPLES, 0 if given is None else len(given[0]) + 2)
    grid = PupilGrid(samples, 2 * radius / (samples - 2), radius)
    stepped = given is None and asked(camera.mask, "regions", lambda: camera.mask.regions(grid))
    height, wavelength = None if stepped else surface(plain, grid), design_wavelength(camera)
    if height is None:
        return
    index = float(camera.mask_material.index(wavelength))
    made = MaskSurface(grid, height.double(), _wrap(camera), index)
    off = camera.lens.misplaced(made, wavelength, camera.field)
    if off > MISPLACED_WAVES:
        angle = math.degrees(math.atan(math.hypot(*camera.field)))
        raise StrongMask(
            f"the mask ({camera.mask.kind}) bends rays by so much that {off:.3g} waves (root mean square, at"
            f" {wavelength * 1e9:.4g} nm, {angle:.3g} degrees off the axis) are missing where its heights are"
            f" added to rays as if they went straight on, more than {MISPLACED_WAVES:g}; take a weaker mask,"
            " a narrower field, or a larger f-number"
        )


def _in_stop(camera: Camera, grid: PupilGrid, regions: Regions, light: Tensor) -> tuple[Regions, Tensor]:
    """Parts of the aperture and their heights, and the light, where rays of the camera's place in the field
    meet the mask."""
    bare, covered = disc_amplitude(grid, grid.radius), disc_coverage(grid, grid.radius)
    if all(part is bare and not isinstance(height, Tensor) for part, height in regions):
        return regions, light
    right, up = grid.centres[None, :], grid.centres.flip(0)[:, None]
    places = camera.lens.in_stop(right, up, camera.field)
    if places is None:
        return regions, light
    u, v = places
    within = grid.radius_squared() < (grid.radius - grid.pitch) ** 2

    def moved(part: Tensor, whole: Tensor) -> Tensor:
        if part is whole:
            return part
        shares = nearest_known(part / whole, within)
        return whole * sampled_at(shares, grid, u, v, NO_WRAPS)

    wrap = _wrap(camera)
    found = [
        (
            moved(part, bare),
            sampled_at(height, grid, u, v, wrap) if isinstance(height, Tensor) else height,
        )
        for part, height in regions
    ]
    return found, moved(light, covered)


def _wrap(camera: Camera) -> float:
    """Height [m] of a wave that may be taken off the mask: of maps, not of formulas."""
    if designed_map(camera) is None and camera.recipe.fabrication is None:
        return NO_WRAPS
    return wave_height(design_wavelength(camera), camera.mask_material)


def _own_amplitude(amplitude: Tensor, grid: PupilGrid) -> Tensor:
    """A camera's amplitude map on a grid of its pupil, [samples, samples], float64."""
    pitch = 2 * grid.radius / len(amplitude)
    return resample(amplitude.double().cpu(), pitch, grid, NO_WRAPS).clamp(0, 1)


@lru_cache(maxsize=64)
def _light(mask: Mask) -> Tensor:
    return mask_amplitude(mask, TRANSMISSION_GRID)[1]


def transmission(camera: Camera) -> float:
    """Fraction of the light through the open aperture that the camera's mask lets through."""
    light = _light(camera.mask)
    if camera.amplitude is not None:
        light = light * _own_amplitude(camera.amplitude.detach(), TRANSMISSION_GRID).square()
    return float(light.sum() / disc_coverage(TRANSMISSION_GRID, 1.0).sum())


def pupil_function(
    camera: Camera,
    opening: Aperture,
    wavelength: float,
    *,
    dtype: torch.dtype = torch.float32,
    device: torch.device | str = "cpu",
) -> Tensor:
    """Pupil function at `wavelength` [m] without defocus, complex [samples, samples]: without Psi and `bent`.

    Phases are summed in float64 and reduced modulo 2 pi before they become `dtype`. A height map in training
    keeps its own precision, since its phase is a few waves only; gradients reach it.
    """
    lens = opening.lens(wavelength)
    waves = []
    for amplitude, heights in opening.regions:
        if isinstance(heights, Tensor) and heights.requires_grad:
            phase = _reduced(lens).to(device=device, dtype=dtype)
            phase = phase + heights.to(device=device, dtype=dtype) * mask_delay(camera, wavelength)
        else:
            phase = _reduced(lens + _fixed_phase(camera, wavelength, heights)).to(device=device, dtype=dtype)
        # not polar: its gradient divides by the amplitude, which is 0 outside the aperture
        amplitude = amplitude.to(device=device, dtype=dtype)
        waves.append(torch.complex(torch.cos(phase) * amplitude, torch.sin(phase) * amplitude))
    return reduce(torch.add, waves)


def bent(pupil: Tensor, opening: Aperture, wavelength: float, inverse_depths: Tensor) -> Tensor:
    """A pupil function with what of the defocus of inverse depths [depth] is no parabola,
    [depth, samples, samples]; itself where all of it is one.

    pupil: [samples, samples], complex.
    inverse_depths: [depth], 1/m.
    opening: the aperture.
    wavelength: metres.
    """
    bend = opening.bend
    if bend is None:
        return pupil
    steps = (inverse_depths.double() - bend.focus)[:, None, None]
    phase = steps * (bend.paths[0] + steps * bend.paths[1]) * (2 * math.pi / wavelength)
    return pupil * torch.polar(torch.ones_like(phase), phase).to(pupil)


def mask_delay(camera: Camera, wavelength: float) -> float:
    """Phase [rad] for each metre of the mask's height: 2 pi (n - 1) / lambda, Akpinar et al., Eq.
    `dtophi`; for light that passes it at an angle, n cos t' - cos t in place of n - 1.
    """
    index, sine = float(camera.mask_material.index(wavelength)), camera.lens.slant(camera.field)
    thicker = math.sqrt(index * index - sine * sine) - math.sqrt(1 - sine * sine) if sine else index - 1
    return 2 * math.pi / wavelength * thicker


def _fixed_phase(camera: Camera, wavelength: float, heights: Tensor | float | None) -> Tensor | float:
    if heights is None:
        return 0.0
    height = heights.detach().to("cpu", torch.float64) if isinstance(heights, Tensor) else heights
    return height * mask_delay(camera, wavelength)


def chirp(
    grid: PupilGrid,
    defocus: Tensor,
    *,
    dtype: torch.dtype = torch.float32,
    device: torch.device | str = "cpu",
) -> Tensor:
    """exp(j Psi s^2 / r^2) along half an axis of the pupil, complex [depth, half].

    defocus: Psi, [depth], radians, float64.
    grid: of the pupil.
    dtype, device: of the result, as real numbers.

    It is even, so it is given from the centre outwards only; the phase of a whole defocus is its product
    along both axes.
    """
    axis = grid.centres[grid.samples // 2 :] / grid.radius
    phase = _reduced(defocus.double()[:, None] * axis**2)
    phase = phase.to(device=device, dtype=dtype)
    return torch.polar(torch.ones_like(phase), phase)


def _reduced(phase: Tensor) -> Tensor:
    return (phase + math.pi).remainder_(2 * math.pi).sub_(math.pi)
