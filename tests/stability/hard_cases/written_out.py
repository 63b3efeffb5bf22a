"""PSFs written out once more, in numpy and float64, as the truth of hard photos: no code of `optics` or
`capture`.

The light of a point at z in the pupil has the phase k [q / 2 (1/z + 1/z_i) - (n - 1) d(q)] with q the squared
radius, d the sag of the lens and z_i the sensor's distance; the mask adds k (n_m - 1) h. Its Fourier integral
is taken by Gauss' rule, piece by piece between the edges of what stands in the pupil, along chords of the
disc; |F|^2 is integrated over each pixel likewise. Nothing is sampled evenly, so nothing can alias.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from importlib import resources

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

CURVATURE = 16.51e-3
"""Of the paper's lens, in metres; with it stand its glass, focus, pixels and resist."""
PIXEL = 6e-6
FOCUS, FOCUS_LINE = 1.5, 587.6e-9
DESIGN_LINE = 543e-9


def silica(wavelength: float) -> float:
    """Refractive index of fused silica: I. H. Malitson, J. Opt. Soc. Am. 55, 1205 (1965)."""
    q = (wavelength * 1e6) ** 2
    terms = ((0.6961663, 0.0684043), (0.4079426, 0.1162414), (0.8974794, 9.896161))
    return math.sqrt(1 + sum(b * q / (q - c * c) for b, c in terms))


def resist(wavelength: float) -> float:
    """Refractive index of S1813: Cauchy's formula with the numbers of its data sheet."""
    um = wavelength * 1e6
    return 1.5935 + 1.8854e-2 / um**2 + 4.1211e-6 / um**4


def sensor_distance() -> float:
    """z_i in metres: 1/f = 1/z + 1/z_i at the line of the focus, with f = R / (n - 1)."""
    return 1 / ((silica(FOCUS_LINE) - 1) / CURVATURE - 1 / FOCUS)


@dataclass(frozen=True)
class Pupil:
    """What stands in the pupil. height: of the relief in metres at (s to the right, t up, in metres); open:
    1 where light passes, at the same; edges: pieces per diameter that either is smooth in."""

    radius: float
    height: Callable[[Array, Array], Array] | None = None
    passes: Callable[[Array, Array], Array] | None = None
    pieces: int = 1
    order: int = 64
    spherical: bool = True
    _nodes: dict[str, Array] = field(default_factory=dict, compare=False, repr=False)

    def nodes(self) -> tuple[Array, Array, Array]:
        """(s [chord], t [chord, node], weight [chord, node]): Gauss' rule on the disc, pieces apart."""
        if not self._nodes:
            at, weight = np.polynomial.legendre.leggauss(self.order)
            breaks = np.linspace(-1.0, 1.0, self.pieces + 1)
            # across: s = r sin a takes the chords' square root out of their ends
            angle, by_angle = _pieces(np.arcsin(breaks), at, weight)
            s, along = self.radius * np.sin(angle), self.radius * np.cos(angle)
            clipped = np.clip(breaks * self.radius, -along[:, None], along[:, None])
            half = np.diff(clipped, axis=1)[:, :, None] / 2
            middle = (clipped[:, 1:] + clipped[:, :-1])[:, :, None] / 2
            t = (middle + half * at).reshape(len(s), -1)
            share = (half * weight).reshape(len(s), -1) * (by_angle * along)[:, None]
            self._nodes.update(s=s, t=t, weight=share)
        return self._nodes["s"], self._nodes["t"], self._nodes["weight"]


def _pieces(breaks: Array, at: Array, weight: Array) -> tuple[Array, Array]:
    half = np.diff(breaks)[:, None] / 2
    middle = (breaks[1:] + breaks[:-1])[:, None] / 2
    return (middle + half * at).ravel(), (half * weight).ravel()


def cubic(radius: float, alpha: float, order: int = 64) -> Pupil:
    """A cubic mask: alpha (u^3 + v^3) radians at the design wavelength."""
    per_radian = DESIGN_LINE / (2 * math.pi * (resist(DESIGN_LINE) - 1))
    return Pupil(
        radius, height=lambda s, t: alpha * per_radian * ((s / radius) ** 3 + (t / radius) ** 3), order=order
    )


def coded(radius: float, rows: Sequence[str], order: int = 12) -> Pupil:
    """Equal square cells that fill the square around the pupil, "1" open, the top row first."""
    cells = np.array([[float(each) for each in row] for row in rows])
    count = len(cells)

    def passes(s: Array, t: Array) -> Array:
        column = np.clip(((s / radius + 1) / 2 * count).astype(int), 0, count - 1)
        row = np.clip(((1 - t / radius) / 2 * count).astype(int), 0, count - 1)
        return cells[row, column]

    return Pupil(radius, passes=passes, pieces=count, order=order)


def height_map(radius: float, height: Array, pitch: float, order: int = 4) -> Pupil:
    """A free height map [n, n] in metres, row 0 the top, cubic between its samples (Keys 1981, a = -1/2), its
    outermost samples repeated."""
    count = len(height)

    def line(place: Array) -> tuple[NDArray[np.int64], Array]:
        first = np.floor(place).astype(np.int64) - 1
        taps = first[..., None] + np.arange(4)
        x = np.abs(place[..., None] - taps)
        near, far = (1.5 * x - 2.5) * x * x + 1, ((-0.5 * x + 2.5) * x - 4) * x + 2
        return np.clip(taps, 0, count - 1), np.where(x <= 1, near, np.where(x < 2, far, 0.0))

    def at(s: Array, t: Array) -> Array:
        s, t = np.broadcast_arrays(s, t)
        (columns, across), (rows, down) = line(s / pitch + (count - 1) / 2), line((count - 1) / 2 - t / pitch)
        values = height[rows[..., :, None], columns[..., None, :]]
        return np.einsum("...i,...ij,...j->...", down, values, across)

    return Pupil(radius, height=at, pieces=2 * count, order=order)


class Psfs:
    """PSFs of one pupil at one wavelength [m], in a window of `window` pixels centred on pixel window // 2.

    A PSF is [y, x], row 0 the top of the upright picture, the light that lands in each pixel as a fraction of
    what passes the pupil. points: of Gauss' rule along a pixel's side."""

    def __init__(self, pupil: Pupil, wavelength: float, window: int, points: int = 3) -> None:
        s, t, weight = pupil.nodes()
        across = np.broadcast_to(s[:, None], t.shape)
        square = across**2 + t**2
        k = 2 * math.pi / wavelength
        distance = sensor_distance()
        if pupil.spherical:
            sag = square / (CURVATURE + np.sqrt(CURVATURE**2 - square))
        else:
            sag = square / (2 * CURVATURE)
        phase = k * (square / 2 / distance - (silica(wavelength) - 1) * sag)
        if pupil.height is not None:
            phase = phase + k * (resist(wavelength) - 1) * pupil.height(across, t)
        passes = np.ones_like(t) if pupil.passes is None else pupil.passes(across, t)
        self._wave = weight * passes * np.exp(1j * phase)
        self._chirp = k * square / 2
        light = float((weight * passes**2).sum())
        at, share = np.polynomial.legendre.leggauss(points)
        place = ((np.arange(window) - window // 2)[:, None] + at / 2).ravel() * PIXEL
        self._share = np.kron(np.eye(window), share[None] / 2) * PIXEL
        reach = wavelength * distance
        self._scale = 1 / (reach**2 * light)
        self._down = np.exp(-2j * math.pi / reach * t[:, :, None] * place)  # rows run downwards, t up
        self._across = np.exp(2j * math.pi / reach * s[:, None] * place)

    def at(self, inverse_depths: Sequence[float]) -> list[Array]:
        """The PSFs of points at 1/z [1/m], one each."""
        chirps = [np.exp(1j * self._chirp * each) for each in inverse_depths]
        waves = np.stack([self._wave * chirp for chirp in chirps], 1)  # [chord, depth, node]
        columns = np.matmul(waves, self._down)  # [chord, depth, y]
        return [self._pixels(columns[:, number].T @ self._across) for number in range(len(chirps))]

    def _pixels(self, found: NDArray[np.complex128]) -> Array:
        density: Array = found.real**2 + found.imag**2
        return self._scale * (self._share @ density @ self._share.T)


@lru_cache(maxsize=1)
def _curves() -> Array:
    """Wavelength in nm, red, green, blue: [row, 4], the paper's response as it ships."""
    path = resources.files("edofsim.optics") / "data" / "sensor_response.csv"
    rows = list(csv.reader(path.read_text(encoding="utf-8").splitlines()))[1:]
    return np.array(rows, dtype=np.float64)


def sensor_response(nanometres: Sequence[float]) -> Array:
    """What each band adds to red, green and blue, [channel, band]: the curves, linear between their points,
    as shares of the bands' sum."""
    table = _curves()
    curves = np.stack([np.interp(nanometres, table[:, 0], column) for column in table.T[1:]])
    return curves / curves.sum(1, keepdims=True)
