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
from . import levin
from .grid import PupilGrid, cell_amplitude, cell_overlap, disc_amplitude, disc_coverage
from .zernike import zernike


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


def _rings(mask: recipes.RingsMask) -> list[tuple[float, float, float]]:
    return [(ring.inner_radius, ring.outer_radius, ring.phase_rad) for ring in mask.rings]


def _annular(mask: recipes.AnnularMask, grid: PupilGrid) -> tuple[Tensor, Tensor]:
    radius = mask.inner_radius * grid.radius
    return 1 - disc_amplitude(grid, radius), 1 - disc_coverage(grid, radius)


def _gaussian(mask: recipes.GaussianMask, grid: PupilGrid) -> tuple[Tensor, Tensor]:
    amplitude = torch.exp(-grid.radius_squared() / (mask.waist * grid.radius) ** 2)
    return amplitude, amplitude**2


def _coded(mask: recipes.CodedMask, grid: PupilGrid) -> tuple[Tensor, Tensor]:
    rows = levin.PATTERN if mask.pattern == recipes.LEVIN else mask.pattern
    cells = torch.tensor([[float(cell) for cell in row] for row in rows], dtype=torch.float64)
    amplitude, light = (
        along(grid, cells.shape[0]).flip(0, 1) @ cells @ along(grid, cells.shape[1]).T
        for along in (cell_amplitude, cell_overlap)
    )
    return amplitude, light


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
STEPPED_PHASES: Mapping[type[RecipeModel], Callable[..., list[tuple[float, float, float]]]] = (
    MappingProxyType({recipes.RingsMask: _rings})
)
AMPLITUDES: Mapping[type[RecipeModel], Callable[..., tuple[Tensor, Tensor]]] = MappingProxyType(
    {recipes.AnnularMask: _annular, recipes.GaussianMask: _gaussian, recipes.CodedMask: _coded}
)


def mask_phase(mask: RecipeModel, grid: PupilGrid) -> Tensor | None:
    """Phase [rad] at the mask's design wavelength, float64 [samples, samples]; None for masks without.

    Cells that an edge of a stepped mask crosses get the mean phase. Height maps have no formula and give
    None.
    """
    if type(mask) in SMOOTH_PHASES:
        u, v = grid.normalised()
        return SMOOTH_PHASES[type(mask)](mask, u, v)
    if type(mask) in STEPPED_PHASES:
        return sum(phase * _ring(grid, inner, outer, disc_coverage) for inner, outer, phase in _steps(mask))
    return None


def mask_regions(mask: RecipeModel, grid: PupilGrid) -> list[tuple[Tensor, float]]:
    """(amplitude [samples, samples], phase [rad] at the design wavelength) of each level of a stepped mask.

    The wave is the sum over regions, so that an edge is as sharp as the grid can show; empty for other masks.
    """
    if type(mask) not in STEPPED_PHASES:
        return []
    rings = [(_ring(grid, inner, outer, disc_amplitude), phase) for inner, outer, phase in _steps(mask)]
    bare = disc_amplitude(grid, grid.radius) - sum(amplitude for amplitude, _ in rings)
    return [(bare, 0.0), *rings]


def mask_amplitude(mask: RecipeModel, grid: PupilGrid) -> tuple[Tensor, Tensor]:
    """(amplitude samples, light) of the aperture with its mask in each cell, float64 [samples, samples].

    Light is the mean squared amplitude. Where an edge crosses a cell it is more than the square of the
    sample: the difference is what the edge scatters beyond the replica period of the sampled pupil.
    """
    amplitude, light = disc_amplitude(grid, grid.radius), disc_coverage(grid, grid.radius)
    if type(mask) not in AMPLITUDES:
        return amplitude, light
    own_amplitude, own_light = AMPLITUDES[type(mask)](mask, grid)
    return amplitude * own_amplitude, light * own_light


def _steps(mask: RecipeModel) -> list[tuple[float, float, float]]:
    return STEPPED_PHASES[type(mask)](mask)


def _ring(grid: PupilGrid, inner: float, outer: float, disc: Callable[[PupilGrid, float], Tensor]) -> Tensor:
    ring = disc(grid, outer * grid.radius)
    return ring - disc(grid, inner * grid.radius) if inner else ring


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
    """What the registry knows of a kind of mask: a default recipe, its meaning in a line, its reference."""

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
