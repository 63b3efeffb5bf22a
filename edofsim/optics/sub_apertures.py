"""The PSF shared out among sub-apertures: which light of it comes through which part of the pupil.

With the pupil function Q = sum_j w_j Q, sum_j w_j = 1, and the field F = sum_j F_j that follows from it,

    |F|^2 = sum_j Re(F* F_j)

for any mask, exactly: each summand is what part j adds to the energy in a place, interference with all the
others included. Rays through a part of the pupil are what it becomes for short waves; that is how light that
something in the way stops in one part, and lets by in another, is distinguished. A summand may be negative.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import lru_cache, partial, reduce

import torch
from torch import Tensor

from ..core.threads import in_threads
from ..errors import InputError
from .camera import Camera, cutoff_frequency
from .grid import PupilGrid
from .masks import Mask, mask_amplitude
from .propagation import Part, Wave, propagate, shared_energies
from .psf import axes_of, carries_gradients, wave_at
from .pupil import aperture
from .sampling import plan_sampling, sampled_alike

MOST_PARTS = 16
"""Along one axis. More have no more to tell than the diffraction at their borders lets them."""
DARK = 0.2
"""Parts of less than this share of the mean part's light are joined to a neighbour."""

COARSER = 4 / 3
"""How much farther apart samples are where pixels are coarse, which sum over finer detail anyway."""
SHARE_SAMPLES = 130
"""Across the pupil, for `between_part_variance`."""
PIECES = 2
"""Of the depths of a wavelength, for threads to share."""
HELD_BYTES = 256 << 20
"""Of parts that are computed together: they share work."""


def sub_aperture_psfs(
    camera: Camera,
    wavelengths: Tensor | Sequence[float],
    inverse_depths: Tensor | Sequence[float],
    across: int,
    *,
    window_px: int | None = None,
    side: int = 1,
    coarsely: bool = False,
    dtype: torch.dtype = torch.float32,
    device: torch.device | str = "cpu",
) -> Iterator[Tensor]:
    """What each sub-aperture adds to the PSFs: one tensor [depth, band, y, x] each, as it is needed.

    camera, wavelengths, inverse_depths, window_px, dtype, device: as of `psf_bank`, [band] and [depth].
    across: sub-apertures along each axis; there are at most across^2, those outside the aperture or behind an
        opaque mask being joined to others.
    side: of the pixels, in pixels of the camera; where it is not 1, the window is the odd one that holds
        `window_px` of these, and samples lie `COARSER` times as far apart.
    coarsely: the pupil is sampled as coarsely as may be for each depth, in place of the recipe's sampling and
        of one that does for all; the sum is then that of such PSFs.

    Their sum is `psf_bank(...).values`; gradients reach the camera's height map. Raises InputError as there,
    and for a number of sub-apertures out of range.
    """
    if not 1 <= across <= MOST_PARTS:
        raise InputError(
            f"{across} sub-apertures across the pupil: give a whole number from 1 to {MOST_PARTS}"
        )
    wavelengths, inverse_depths = axes_of(camera, wavelengths, inverse_depths)
    pixels = camera.recipe.psf.window_px if window_px is None else window_px
    trained = carries_gradients(camera)
    groups = [(torch.arange(len(inverse_depths)), camera)]
    if coarsely:
        alike = sampled_alike(camera, wavelengths, inverse_depths, pixels)
        if trained:  # all on the finest grid
            alike = [(groups[0][0], min(pitch for _, pitch in alike))]
        groups = [(depths, camera.with_pupil_sampling(pitch)) for depths, pitch in alike]
    grids = [
        plan_sampling(sampled, wavelengths, inverse_depths[depths], pixels) for depths, sampled in groups
    ]
    where = torch.device(device)
    pixels = coarse_window(pixels, side)

    def waves_on(grid: PupilGrid, depths: Tensor) -> list[Wave]:
        opening = aperture(camera, grid)
        waves = []
        for wavelength in wavelengths.tolist():
            samples = coarse_oversampling(camera, wavelength, side)
            how = (dtype, where, side * camera.pixel, samples)
            waves.append(wave_at(camera, opening, wavelength, depths, pixels, *how))
        return waves

    waves = [waves_on(grid, inverse_depths[depths]) for grid, (depths, _) in zip(grids, groups, strict=True)]
    exact = [windows_along(grid, across) for grid in grids]
    along = [windows.to(where, dtype) for windows in exact]
    intensity = reduce(torch.add, (wave.pupil.detach().abs().square() for wave in waves[0])).double().cpu()
    parts = partition(exact[0], intensity)
    if trained:
        for part in parts:
            yield _part(waves[0], _window(along[0], part))[..., :pixels, :pixels]
        return
    # few wavelengths are few pieces of work; however many threads there are, the same ones
    pieces = [
        (wave.part(slice(start, start + size)), windows)
        for same, windows in zip(waves, along, strict=True)
        for wave in same
        for size in [math.ceil(len(wave.chirps) / PIECES)]
        for start in range(0, len(wave.chirps), size)
    ]
    order = torch.cat([depths for depths, _ in groups]).argsort().to(where)
    size = along[0].element_size() * len(wavelengths) * len(inverse_depths) * pixels**2
    at_once = max(1, HELD_BYTES // size)
    for start in range(0, len(parts), at_once):
        several = parts[start : start + at_once]
        found = iter(in_threads(partial(_shared, parts=several), pieces, where))
        of_groups = [
            torch.stack([torch.cat([next(found) for _ in wave.chirps.chunk(PIECES)], 1) for wave in same], 2)
            for same in waves
        ]
        for values in torch.cat(of_groups, 1)[:, order]:
            yield values[..., :pixels, :pixels]


def _shared(piece: tuple[Wave, Tensor], parts: Sequence[Part]) -> Tensor:
    return shared_energies(*piece, parts)


def between_part_variance(camera: Camera, across: int) -> float:
    """Share of the variance of places in the pupil that lies between `across` x `across` sub-apertures, at
    most 1. The rest lies within them.

    What an edge hides depends on how the light of both surfaces correlates over the pupil. Where both change
    evenly across it, that is proportional to this variance, to second order; each sub-aperture taken as a
    whole loses the variance within it.
    """
    return _between_part_variance(camera.mask, across)


@lru_cache(maxsize=64)
def _between_part_variance(mask: Mask, across: int) -> float:
    grid = PupilGrid(SHARE_SAMPLES, 2 / (SHARE_SAMPLES - 2), 1.0)
    intensity = mask_amplitude(mask, grid)[1].double()
    along = windows_along(grid, across)
    parts = partition(along, intensity)
    light, place = intensity.sum(), grid.centres
    middle = torch.stack([(intensity.sum(1) @ place), (intensity.sum(0) @ place)]) / light
    whole = (intensity * grid.radius_squared()).sum() - light * middle.square().sum()
    between = torch.zeros((), dtype=torch.float64)
    for part in parts:
        seen = _window(along, part) * intensity
        own = torch.stack([seen.sum(1) @ place, seen.sum(0) @ place]) / seen.sum()
        between += seen.sum() * (own - middle).square().sum()
    return float(between / whole)


def coarse_window(pixels: int, side: int) -> int:
    """Width in pixels of `side` of the window that holds one of this many of the camera's."""
    return pixels if side == 1 else 2 * math.ceil(pixels // 2 / side) + 1


def coarse_oversampling(camera: Camera, wavelength: float, side: int) -> int:
    """Samples along a pixel of `side` at `wavelength` [m]: as far apart as `COARSER` says, and still one for
    each period of the finest fringes, without which parts of the pupil have too much or too little light."""
    fine = camera.oversampling(wavelength)
    fringes = math.ceil(side * camera.pixel * cutoff_frequency(camera, wavelength) - 1e-9)
    return fine if side == 1 else max(math.ceil(side * fine / COARSER), min(side * fine, fringes))


def windows_along(grid: PupilGrid, across: int) -> Tensor:
    """Smooth windows along an axis of the pupil, float64 [across, samples], that sum to 1 everywhere: raised
    cosines around the middles of `across` equal parts; a hard border would scatter what comes through a part
    all over the sensor."""
    axis = grid.centres / grid.radius
    place = ((axis + 1) * across / 2 - 0.5).clamp(0, across - 1)  # in parts, 0 at the middle of the first
    apart = (place - torch.arange(across, dtype=torch.float64)[:, None]).abs().clamp_max(1)
    # exactly zero outside, where a cosine is not: what is dark is then left out of the transforms
    return torch.where(apart < 1, torch.cos(math.pi / 2 * apart) ** 2, 0.0)


def partition(along: Tensor, intensity: Tensor) -> tuple[Part, ...]:
    """The parts: each the products of a window along y and one along x, of all places that it is joined from.

    along: [window, samples], from `windows_along`.
    intensity: float64 [samples, samples], of the light in the pupil: places that hold next to none of it are
        joined to the nearest that do.
    """
    across = len(along)
    held = (along @ intensity @ along.T).flatten()
    bright = torch.nonzero(held >= DARK * held.mean()).squeeze(1)
    middles = torch.cartesian_prod(*2 * (torch.arange(across, dtype=torch.float64),)).reshape(-1, 2)
    nearest = torch.cdist(middles, middles[bright]).argmin(1).tolist()
    places = [divmod(place, across) for place in range(across**2)]
    return tuple(
        tuple(place for place, to in zip(places, nearest, strict=True) if to == part)
        for part in range(len(bright))
    )


def _window(along: Tensor, part: Part) -> Tensor:
    return reduce(torch.add, (torch.outer(along[y], along[x]) for y, x in part))


def _part(waves: Sequence[Wave], window: Tensor) -> Tensor:
    """Re(F* F_j) = (|F + F_j|^2 - |F - F_j|^2) / 4 in each pixel, [depth, band, pixel, pixel]: slowly, and
    differentiable."""
    more, less = ([replace(wave, pupil=wave.pupil * (1 + s * window)) for wave in waves] for s in (1, -1))
    return (propagate(more) - propagate(less)) / 4
