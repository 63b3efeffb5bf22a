"""The registry of masks: for each kind its phase or its amplitude over the pupil."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import get_args

import torch
from torch import Tensor

from ..recipe import masks as recipes
from ..recipe.base import RecipeModel
from .grid import PupilGrid, cell_overlap, disc_coverage
from .zernike import zernike

LEVIN_PATTERN = (
    "0001110000000",
    "0001110000000",
    "0001110001110",
    "1110001111110",
    "1110001111110",
    "1110001110000",
    "0001111111110",
    "0001111110000",
    "0001111110000",
    "1110000001110",
    "1110000001110",
    "1110001110000",
    "0000001110000",
)


def _cubic(mask: recipes.CubicMask, u: Tensor, v: Tensor) -> Tensor:
    return mask.alpha_rad * (u**3 + v**3)


def _logarithmic(mask: recipes.LogarithmicMask, u: Tensor, v: Tensor) -> Tensor:
    def profile(w: Tensor) -> Tensor:
        size = w.abs()
        return w.sign() * (torch.xlogy(size**2, size) + mask.beta * size**2)

    return mask.alpha_rad * (profile(u) + profile(v))


def _sinusoidal(mask: recipes.SinusoidalMask, u: Tensor, v: Tensor) -> Tensor:
    return mask.alpha_rad * (u**4 * torch.sin(mask.beta_rad * u) + v**4 * torch.sin(mask.beta_rad * v))


def _tangent(mask: recipes.TangentMask, u: Tensor, v: Tensor) -> Tensor:
    # beyond the pupil, in the corners of the grid, the tangent may run away: it is dark there
    u, v = u.clamp(-1, 1), v.clamp(-1, 1)
    return mask.alpha_rad * (u**2 * torch.tan(mask.beta_rad * u) + v**2 * torch.tan(mask.beta_rad * v))


def _zernike(mask: recipes.ZernikeMask, u: Tensor, v: Tensor) -> Tensor:
    return sum(term.rms_rad * zernike(term.noll, u, v) for term in mask.terms)


def _fourier(mask: recipes.FourierMask, u: Tensor, v: Tensor) -> Tensor:
    phase = torch.zeros(torch.broadcast_shapes(u.shape, v.shape), dtype=u.dtype)
    for term in mask.terms:
        angle = math.pi * (term.p * u + term.q * v)
        phase = phase + term.cosine_rad * torch.cos(angle) + term.sine_rad * torch.sin(angle)
    return phase


def _rings(mask: recipes.RingsMask, grid: PupilGrid) -> Tensor:
    phase = torch.zeros(grid.samples, grid.samples, dtype=torch.float64)
    for ring in mask.rings:
        outer = disc_coverage(grid, ring.outer_radius * grid.radius)
        inner = disc_coverage(grid, ring.inner_radius * grid.radius) if ring.inner_radius else 0.0
        phase = phase + ring.phase_rad * (outer - inner)
    return phase


Amplitude = tuple[Tensor, Tensor]


def _annular(mask: recipes.AnnularMask, grid: PupilGrid) -> Amplitude:
    open_part = 1 - disc_coverage(grid, mask.inner_radius * grid.radius)
    return open_part, open_part


def _gaussian(mask: recipes.GaussianMask, grid: PupilGrid) -> Amplitude:
    amplitude = torch.exp(-grid.radius_squared() / (mask.waist * grid.radius) ** 2)
    return amplitude, amplitude**2


def _coded(mask: recipes.CodedMask, grid: PupilGrid) -> Amplitude:
    rows = LEVIN_PATTERN if mask.pattern == recipes.LEVIN else mask.pattern
    cells = torch.tensor([[float(cell) for cell in row] for row in rows], dtype=torch.float64)
    down = cell_overlap(grid, cells.shape[0]).flip(0, 1)
    across = cell_overlap(grid, cells.shape[1])
    open_part = down @ cells @ across.T
    return open_part, open_part


SMOOTH_PHASES: Mapping[type[RecipeModel], Callable[..., Tensor]] = MappingProxyType(
    {
        recipes.CubicMask: _cubic,
        recipes.LogarithmicMask: _logarithmic,
        recipes.SinusoidalMask: _sinusoidal,
        recipes.TangentMask: _tangent,
        recipes.ZernikeMask: _zernike,
        recipes.FourierMask: _fourier,
    }
)
STEPPED_PHASES: Mapping[type[RecipeModel], Callable[..., Tensor]] = MappingProxyType({recipes.RingsMask: _rings})
AMPLITUDES: Mapping[type[RecipeModel], Callable[..., Amplitude]] = MappingProxyType(
    {recipes.AnnularMask: _annular, recipes.GaussianMask: _gaussian, recipes.CodedMask: _coded}
)


def mask_phase(mask: RecipeModel, grid: PupilGrid) -> Tensor | None:
    """Phase [rad] at the mask's design wavelength on a grid, float64 [samples, samples]; None if it has none.

    Height maps have no formula and give None too (`height.py` reads them).
    """
    if type(mask) in SMOOTH_PHASES:
        u, v = grid.normalised()
        return SMOOTH_PHASES[type(mask)](mask, u, v)
    if type(mask) in STEPPED_PHASES:
        return STEPPED_PHASES[type(mask)](mask, grid)
    return None


def mask_amplitude(mask: RecipeModel, grid: PupilGrid) -> Amplitude:
    """(mean amplitude, mean squared amplitude) of the aperture with its mask in each cell, float64.

    The two differ where an edge crosses a cell: all light of its open part counts (the second), but a cell of
    one amplitude (the first) carries less; the difference is light that such an edge scatters beyond the
    first replica of the pupil.
    """
    aperture = disc_coverage(grid, grid.radius)
    if type(mask) not in AMPLITUDES:
        return aperture, aperture
    amplitude, power = AMPLITUDES[type(mask)](mask, grid)
    return aperture * amplitude, aperture * power


def mask_slope(mask: RecipeModel) -> float:
    """Steepest phase of a smooth mask within the pupil [rad per pupil radius] at its design wavelength.

    0 for masks without phase and for stepped ones, whose edges are as sharp as the grid shows them.
    """
    if type(mask) not in SMOOTH_PHASES:
        return 0.0
    axis = torch.linspace(-1, 1, 513, dtype=torch.float64)
    u, v = axis[None, :], axis.flip(0)[:, None]
    phase = torch.where(u**2 + v**2 <= 1, SMOOTH_PHASES[type(mask)](mask, u, v), torch.nan)
    steps = torch.cat([phase.diff(dim=0).flatten(), phase.diff(dim=1).flatten()]).abs()
    return float(steps.nan_to_num(0).max()) / float(axis[1] - axis[0])


@dataclass(frozen=True)
class MaskEntry:
    """What the registry knows of a kind of mask: a default recipe, its one-line meaning, and its reference."""

    kind: str
    example: RecipeModel
    summary: str
    reference: str


def catalogue() -> tuple[MaskEntry, ...]:
    """All kinds of mask, in the order of the recipe's union, each with its defaults."""
    union = get_args(recipes.AnyMask)[0]
    entries = []
    for model in get_args(union):
        example = model()
        summary, _, rest = (model.__doc__ or "").partition("\n")
        entries.append(MaskEntry(example.kind, example, summary.strip(), " ".join(rest.split())))
    return tuple(entries)
