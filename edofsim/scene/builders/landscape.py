"""What lies far away or grows: hills, clouds, house fronts, foliage."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from ...recipe.base import NotNegative, Positive
from ...recipe.placed import Placed
from ...recipe.surfaces import AnySurface, MattSurface, NoiseTexture
from .. import solids
from ..model import TriangleMesh
from ..spectra import illuminant, reflectance
from ..surfaces import matt
from ..textures import flat, mixture
from .context import Builder, Context, Part

MM = 1e-3


class Hills(Builder, Placed):
    """A ridge of hills across the view; `height_mm` and `base_mm` are measured from y."""

    kind: Literal["hills"]
    width_mm: Positive
    """width, mm"""
    height_mm: Positive
    """height of the ridge above y, mm"""
    base_mm: NotNegative = 0.0
    """how far the slope goes on below y"""
    roughness: Annotated[float, Field(ge=0, le=2)] = 1.0
    """how quickly the ridge's small features fade: 0 jagged, 2 smooth"""
    surface: AnySurface = MattSurface(kind="matt", reflectance="foliage")
    """what they are made of"""
    anchor: Literal["centre", "base"] = "centre"
    """what `x`, `y` place: the middle of the ridge's foot, or of its base"""

    def build(self, context: Context) -> list[Part]:
        """A ridge: octaves of waves along x give its height, and its face leans away from the camera."""
        width, height, base = self.width_mm * MM, self.height_mm * MM, self.base_mm * MM
        rng = context.rng("ridge")
        columns, rows = 400, 24
        u = np.linspace(0, 1, columns)
        ridge = np.zeros(columns)
        for octave in range(1, 9):
            waves = 2**octave / 2
            amplitude = waves ** -(0.5 + 0.5 * self.roughness)
            ridge += amplitude * np.sin(2 * np.pi * (waves * u * rng.uniform(0.8, 1.2) + rng.uniform()))
        ridge = (ridge - ridge.min()) / np.ptp(ridge)
        top = height * (0.45 + 0.55 * ridge)
        v = np.linspace(0, 1, rows)[:, None]
        bumps = rng.standard_normal((rows, columns)) * 0.01 * height
        y = -base + (top + base) * v
        z = 1.5 * (y + base) + bumps
        x = np.broadcast_to((u - 0.5) * width, y.shape)
        # the texture is as wide as the slope is high, so that its spots are round
        uv = np.stack(np.broadcast_arrays(u * width / (height + base), v), -1)
        vertices = np.stack([x, y, z], -1).reshape(-1, 3)
        shape = solids.mesh(vertices, solids.grid_faces(rows, columns), uv.reshape(-1, 2))
        return [Part("", shape, context.surface(self.surface))]


class CloudBank(Builder, Placed):
    """A picture of cumulus clouds on blue, to be put so far away that it is at infinity for any lens.

    It scatters the scene's light, so it is as bright as a white paper there; `cover` is the fraction of
    the sky behind clouds."""

    kind: Literal["clouds"]
    width_mm: Positive
    """width of the picture, mm"""
    height_mm: Positive
    """height of the picture, mm"""
    cover: Annotated[float, Field(ge=0.05, le=0.95)] = 0.5
    """share of the sky behind clouds"""
    pixels: Annotated[int, Field(ge=64, le=4096)] = 1024
    """texture pixels along the longer side"""
    blue: str = "#3f74b5"
    """colour of the sky, #rrggbb"""
    anchor: Literal["centre", "base"] = "centre"
    """what `x`, `y` place: its centre, or the middle of its base"""

    def build(self, context: Context) -> list[Part]:
        """A panel with a picture of clouds: noise of many octaves, white where it is high, shaded below."""
        width, height = self.width_mm * MM, self.height_mm * MM
        longer = max(width, height)
        rows, columns = (max(16, round(self.pixels * side / longer)) for side in (height, width))
        density = _cloud_density((rows, columns), context.rng("clouds"))
        edge = np.quantile(density, 1 - self.cover)
        thick = np.clip((density - edge) / (0.35 * (density.max() - edge)), 0, 1)
        cover = thick * thick * (3 - 2 * thick)
        # the sun stands above: a cloud is darker where there is more of it higher up
        above = np.stack([np.roll(cover, s, axis=0) for s in range(1, 1 + max(1, rows // 24))]).mean(axis=0)
        white = 0.95 - 0.35 * cover * above
        blue, grey = (reflectance(r, context.wavelengths) for r in (self.blue, 1.0))
        fade = np.linspace(0.75, 1.0, rows)[:, None]  # paler towards the horizon
        sky = mixture(cover, blue, grey)
        image = np.stack([(1 - cover) * fade, cover * white + (1 - cover) * (1 - fade) * 0.8], axis=-1)
        picture = type(sky)(sky.basis, image.astype(np.float32))
        return [Part("", solids.panel(width, height), matt(picture))]


def _cloud_density(shape: tuple[int, int], rng: np.random.Generator) -> np.ndarray:
    """Noise whose amplitude falls as frequency^-1.7 in a plane, float64 [y, x]; billows are its folds."""
    size = 2 * max(shape)  # a tile twice as large, so that the two sides of the picture differ
    fy, fx = np.fft.fftfreq(size)[:, None], np.fft.rfftfreq(size)[None]
    frequency = np.hypot(fy * 1.4, fx) * size
    spectrum = np.where(frequency > 5, np.maximum(frequency, 1.0) ** -1.8, 0)
    noise = np.fft.irfft2(np.fft.rfft2(rng.standard_normal((size, size))) * spectrum, s=(size, size))
    noise /= noise.std()
    return (noise + 0.35 * (1 - np.abs(np.roll(noise, size // 3, axis=1))))[: shape[0], : shape[1]]


class Facade(Builder, Placed):
    """The front of a dark house with rows of windows, some of them lit."""

    kind: Literal["facade"]
    width_mm: Positive
    """width, mm"""
    height_mm: Positive
    """height, mm"""
    columns: Annotated[int, Field(ge=1, le=200)] = 8
    """windows across"""
    rows: Annotated[int, Field(ge=1, le=200)] = 6
    """windows up"""
    lit: Annotated[float, Field(ge=0, le=1)] = 0.4
    """share of the windows that are lit"""
    radiance: NotNegative = 5.0
    """radiance of a lit window, W/m2/sr/nm"""
    illuminant: str = "LED-B1"
    """spectrum of a lit window: a CIE illuminant"""
    surface: AnySurface = MattSurface(kind="matt", reflectance=0.08)
    """surface of the wall"""

    def build(self, context: Context) -> list[Part]:
        """A wall with a grid of windows; lit ones shine, the others are dark glass."""
        width, height = self.width_mm * MM, self.height_mm * MM
        pitch_x, pitch_y = width / self.columns, height / self.rows
        lit = context.rng("lit").random((self.rows, self.columns)) < self.lit
        panes: dict[bool, list[TriangleMesh]] = {True: [], False: []}
        for row in range(self.rows):
            for column in range(self.columns):
                centre = (
                    (column + 0.5) * pitch_x - width / 2,
                    (row + 0.5) * pitch_y - height / 2,
                    -1e-3 * pitch_x,
                )
                panes[bool(lit[row, column])].append(solids.panel(0.55 * pitch_x, 0.55 * pitch_y, centre))
        parts = [Part("", solids.panel(width, height), context.surface(self.surface))]
        dark = matt(flat(0.02, context.wavelengths))
        if panes[False]:
            parts.append(Part("dark windows", solids.join(panes[False]), dark))
        if panes[True]:
            shine = self.radiance * illuminant(self.illuminant, context.wavelengths)
            parts.append(Part("lit windows", solids.join(panes[True]), dark, shine.astype(np.float32)))
        return parts


class Foliage(Builder, Placed):
    """Leaves on thin stems, scattered through a block of space about its centre."""

    kind: Literal["foliage"]
    width_mm: Positive
    """extent along x, mm"""
    height_mm: Positive
    """extent along y, mm"""
    length_mm: Positive
    """extent along z"""
    leaves: Annotated[int, Field(ge=1, le=20000)] = 300
    """number of leaves"""
    leaf_mm: Positive = 8.0
    """length of a leaf, mm"""
    slenderness: Annotated[float, Field(ge=1, le=40)] = 3.0
    """length of a leaf over its width; blades of grass have 20 and more"""
    stems: Annotated[int, Field(ge=0, le=500)] = 12
    """number of stems"""
    stem_mm: Positive = 0.4
    """thickness of a stem, mm"""
    upright: Annotated[float, Field(ge=0, le=1)] = 0.3
    """0: leaves point anywhere; 1: they all stand up"""
    surface: AnySurface = MattSurface(
        kind="matt", texture=NoiseTexture(kind="noise", first="#2f5a1e", second="#9dbb4a", grain=0.05)
    )
    """what leaves and stems are made of"""
    anchor: Literal["centre", "base"] = "centre"
    """what `x`, `y` place: its centre, or the middle of its base"""

    def build(self, context: Context) -> list[Part]:
        """Bent leaves of four quads, each with its own spot of the texture, and curved stems."""
        rng = context.rng("leaves")
        size = np.array([self.width_mm, self.height_mm, self.length_mm]) * MM
        parts = [Part("", _leaves(self, rng, size), context.surface(self.surface))]
        if self.stems:
            stems = [_stem(rng, size, self.stem_mm / 2 * MM) for _ in range(self.stems)]
            parts.append(Part("stems", solids.join(stems), matt(flat("#5a4a2c", context.wavelengths))))
        return parts


def _leaves(recipe: Foliage, rng: np.random.Generator, size: np.ndarray) -> TriangleMesh:
    n = recipe.leaves
    length = recipe.leaf_mm * MM * rng.uniform(0.6, 1.3, n)
    base = rng.uniform(-0.5, 0.5, (n, 3)) * size
    along = rng.standard_normal((n, 3)) + [0, 6 * recipe.upright / (1.02 - recipe.upright), 0]
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    side = np.cross(along, rng.standard_normal((n, 3)))
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    bend = np.cross(side, along)
    t = np.linspace(0, 1, 5)
    half = np.sin(np.pi * np.clip(t, 0.04, 0.96)) / (2 * recipe.slenderness)  # a pointed oval
    curve = rng.uniform(-0.5, 0.5, n)
    spine = (
        base[:, None]
        + along[:, None] * (t[:, None] * length[:, None, None])
        + bend[:, None] * (t[:, None] ** 2 * (curve * length)[:, None, None])
    )
    wing = side[:, None] * (half[:, None] * length[:, None, None])
    vertices = np.stack([spine - wing, spine + wing], axis=2)  # [leaf, station, side, 3]
    one = solids.grid_faces(5, 2)
    faces = (one[None] + 10 * np.arange(n)[:, None, None]).reshape(-1, 3)
    spot = rng.uniform(0, 1, (n, 1, 1, 2))
    local = np.stack(np.broadcast_arrays([0.0, 1.0], t[:, None]), -1)[None] * 0.02
    uv = np.broadcast_to(spot + local, (n, 5, 2, 2))
    return solids.mesh(vertices.reshape(-1, 3), faces, uv.reshape(-1, 2))


def _stem(rng: np.random.Generator, size: np.ndarray, radius: float) -> TriangleMesh:
    foot = rng.uniform(-0.5, 0.5, 3) * size * [1, 0, 1] - [0, size[1] / 2, 0]
    lean = rng.uniform(-0.25, 0.25, 3) * size * [1, 0, 1]
    t = np.linspace(0, 1, 14)[:, None]
    wave = np.sin(np.pi * t * rng.uniform(0.5, 2)) * rng.uniform(-0.08, 0.08) * size[0]
    path = foot + t * (np.array([0, size[1] * rng.uniform(0.6, 1.0), 0]) + lean) + wave * [1, 0, 0.5]
    return solids.tube(path, radius, 8)
