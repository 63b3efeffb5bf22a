"""Square sampling grids of the pupil, centred on the optical axis, and resampling between them.

Arrays are seen from the sensor towards the scene: row 0 is the top of the pupil, column 0 its left side.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import torch
from torch import Tensor


@dataclass(frozen=True)
class PupilGrid:
    """`samples` x `samples` square cells of side `pitch` [m] over a pupil of `radius` [m]."""

    samples: int
    pitch: float
    radius: float

    @property
    def centres(self) -> Tensor:
        """Cell centres along one axis in metres, ascending, float64 [samples]."""
        return (torch.arange(self.samples, dtype=torch.float64) - (self.samples - 1) / 2) * self.pitch

    def normalised(self) -> tuple[Tensor, Tensor]:
        """(u [1, samples] to the right, v [samples, 1] upwards), in units of the pupil's radius, float64."""
        axis = self.centres / self.radius
        return axis[None, :], axis.flip(0)[:, None]

    def radius_squared(self) -> Tensor:
        """s^2 + t^2 at the cell centres in square metres, float64 [samples, samples]."""
        square = self.centres**2
        return square[:, None] + square[None, :]


NO_WRAPS = 1e9
"""A wave that no map's steps reach."""
LINES = 16
"""Lines a cell on which the chord of a disc is measured: the area of a disc comes out to 1e-5 and better."""


@lru_cache(maxsize=8)
def disc_coverage(grid: PupilGrid, radius: float) -> Tensor:
    """Fraction of each cell that a centred disc of `radius` [m] covers, float64 [samples, samples].

    Grey edges: each cell is crossed by lines on which the disc's chord is exact (midpoint rule in between).
    One quadrant is measured, the others mirror it.
    """
    centres = grid.centres[grid.samples // 2 :]
    left, right = centres - grid.pitch / 2, centres + grid.pitch / 2
    covered, to, since = torch.zeros(3, len(centres), len(centres), dtype=torch.float64)
    for line in range(LINES):
        height = left + (line + 0.5) / LINES * grid.pitch
        half_chord = (radius**2 - height**2).clamp_min(0).sqrt()[:, None]
        torch.clamp(right, -half_chord, half_chord, out=to)
        covered += to.sub_(torch.clamp(left, -half_chord, half_chord, out=since))
    quadrant = (covered + covered.T) / (2 * LINES * grid.pitch)  # as exact down as across
    half = torch.cat([quadrant.flip(0)[: grid.samples // 2], quadrant])
    return torch.cat([half.flip(1)[:, : grid.samples // 2], half], 1)


@lru_cache(maxsize=8)
def disc_amplitude(grid: PupilGrid, radius: float) -> Tensor:
    """A disc as samples whose Fourier transform is that of the disc, float64 [samples, samples].

    Cell averages, as `disc_coverage` gives them, weaken the light that the edge scatters to the rim of the
    sensor window; a quarter of the replica period away it is a fifth too dim. Adding 1/24 of the negative
    second difference along both axes undoes that to fourth order (averages to point values, as in finite
    volumes).
    """
    covered = torch.nn.functional.pad(disc_coverage(grid, radius), (1, 1, 1, 1))
    for axis in (0, 1):
        bend = covered.roll(1, axis).sub_(covered, alpha=2).add_(covered.roll(-1, axis))
        covered -= bend.div_(24)
    return covered[1:-1, 1:-1]


def cell_overlap(grid: PupilGrid, cells: int) -> Tensor:
    """Fraction of each grid cell that each of `cells` equal parts of the pupil's diameter covers.

    Along one axis, [samples, cells], float64; both run in ascending order.
    """
    edges = _edges(grid, cells)
    left, right = (grid.centres - grid.pitch / 2)[:, None], (grid.centres + grid.pitch / 2)[:, None]
    overlap = torch.minimum(right, edges[1:]) - torch.maximum(left, edges[:-1])
    return overlap.clamp_min(0) / grid.pitch


def cell_amplitude(grid: PupilGrid, cells: int) -> Tensor:
    """The same parts as samples whose Fourier transform is that of a part; shaped as `cell_overlap`.

    Straight edges along the grid would scatter too much or too little light by where they cross the cells;
    as the integral of a Lanczos kernel they scatter the same wherever they lie.
    """
    steps = _step((grid.centres[:, None] - _edges(grid, cells)) / grid.pitch)
    return steps[:, :-1] - steps[:, 1:]


def _edges(grid: PupilGrid, cells: int) -> Tensor:
    return torch.linspace(-grid.radius, grid.radius, cells + 1, dtype=torch.float64)


def _step(position: Tensor) -> Tensor:
    """Band-limited unit step at 0, position in cells: the integral of sinc(x) sinc(x / 3), |x| < 3."""
    table = _step_table()
    place = ((position + 3) * ((len(table) - 1) / 6)).clamp(0, len(table) - 1)
    below = place.floor().long().clamp_max(len(table) - 2)
    return torch.lerp(table[below], table[below + 1], place - below)


@lru_cache(maxsize=1)
def _step_table() -> Tensor:
    x = torch.linspace(-3, 3, 6001, dtype=torch.float64)
    integral = torch.cumulative_trapezoid(torch.sinc(x) * torch.sinc(x / 3), x)
    return torch.nn.functional.pad(integral / integral[-1], (1, 0))


@lru_cache(maxsize=16)
def bicubic_matrix(samples_to: int, pitch_to: float, samples_from: int, pitch_from: float) -> Tensor:
    """Interpolation along one axis between two centred grids, float64 [samples_to, samples_from].

    R. G. Keys' cubic convolution kernel with a = -1/2 (IEEE Trans. ASSP 29, 1153, 1981); the outermost sample
    is repeated beyond the edge. Apply as matrix @ map @ matrix.T.
    """
    to = (torch.arange(samples_to, dtype=torch.float64) - (samples_to - 1) / 2) * pitch_to
    position = to / pitch_from + (samples_from - 1) / 2
    first = torch.floor(position).long() - 1
    matrix = torch.zeros(samples_to, samples_from, dtype=torch.float64)
    for tap in range(4):
        weight = _keys(position - (first + tap))
        column = (first + tap).clamp(0, samples_from - 1)
        matrix.scatter_add_(1, column[:, None], weight[:, None])
    return matrix


def _keys(distance: Tensor) -> Tensor:
    x = distance.abs()
    near = (1.5 * x - 2.5) * x * x + 1
    far = ((-0.5 * x + 2.5) * x - 4) * x + 2
    return torch.where(x <= 1, near, torch.where(x < 2, far, torch.zeros_like(x)))


def resample(surface: Tensor, pitch_from: float, grid: PupilGrid, wave: float) -> Tensor:
    """A centred square map [n, n] of pitch `pitch_from` [m] on another grid, bicubic, [samples, samples].

    surface: [n, n], centred.
    wave: height [m] of one wave of the light that the map is designed for.
    pitch_from: metres between the map's samples.
    grid: the grid wanted.

    A step between neighbours of more than half a wave is a wrap, where whole waves were taken off (K. Itoh,
    "Analysis of the phase unwrapping algorithm", Appl. Opt. 21, 2470, 1982): it stays a step, halfway between
    the two. Smoothed into a ramp it would scatter the light that it leaves alone.
    """
    same_pitch = abs(grid.pitch / pitch_from - 1) < 1e-9
    if same_pitch and surface.shape[-1] == grid.samples:
        return surface
    matrix = bicubic_matrix(grid.samples, grid.pitch, surface.shape[-1], pitch_from).to(surface)
    position = grid.centres / pitch_from + (surface.shape[-1] - 1) / 2
    nearest = position.round().long().clamp(0, surface.shape[-1] - 1).to(surface.device)
    rows = _between_wraps(surface, matrix, nearest, wave)
    return _between_wraps(rows.T, matrix, nearest, wave).T


def _between_wraps(surface: Tensor, matrix: Tensor, nearest: Tensor, wave: float) -> Tensor:
    """Rows of a map interpolated by `matrix` [to, from] without their wraps, which come back as they are in
    the `nearest` [to] samples."""
    taken = torch.nn.functional.pad((surface.detach().diff(dim=-1) / wave).round().cumsum(-1), (1, 0)) * wave
    return (surface - taken) @ matrix.T + taken[:, nearest]


def sampled_at(surface: Tensor, grid: PupilGrid, u: Tensor, v: Tensor, wave: float) -> Tensor:
    """Maps of a grid at other places, bicubic, with their wraps, see `resample`: [..., place].

    surface: [..., samples, samples].
    u, v: [place], of any shape, to the right and up, in radii.
    wave: as in `resample`; between wraps, a place is in the same whole wave as the nearest sample.
    """
    last = grid.samples - 1
    across, down = (last / 2 + sign * at * (grid.radius / grid.pitch) for sign, at in ((1, u), (-1, v)))
    row, column = (at.round().long().clamp(0, last) for at in (down, across))
    nearest = surface.detach()[..., row, column]
    total = above = taken = torch.zeros_like(nearest)
    for y, high in _taps(down, last):
        before, off = above, taken
        for tap, (x, broad) in enumerate(_taps(across, last)):
            value = surface[..., y, x]
            off = off + ((value.detach() - before) / wave).round()
            before = value.detach()
            if tap == 0:
                above, taken = before, off
            total = total + (value - off * wave) * (high * broad).to(value)
    return total - ((total.detach() - nearest) / wave).round() * wave


def _taps(at: Tensor, last: int) -> list[tuple[Tensor, Tensor]]:
    """The four samples around places, from 0 to `last`, and their weights."""
    first = at.floor()
    return [((first + tap).long().clamp(0, last), _keys(at - first - tap)) for tap in range(-1, 3)]
