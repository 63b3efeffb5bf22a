"""Toy vehicles, each from a few lofted bodies: a bus and a car that drive to the right.

Lengths are fractions of the vehicle's length; y = 0 is the road, the wheels stand on it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import numpy as np

from ...recipe.base import Positive
from ...recipe.placed import Placed
from ...recipe.surfaces import AnySurface, PlasticSurface
from .. import printing, solids
from ..model import Surface, TriangleMesh
from ..spectra import reflectance
from ..surfaces import matt
from ..textures import flat, mixture
from .context import Builder, Context, Part

Profile = Callable[[np.ndarray], np.ndarray]


def _gloss(context: Context, value: float | str, roughness: float = 0.05) -> Surface:
    return context.surface(PlasticSurface(kind="plastic", reflectance=value, roughness=roughness))


def _body(
    x: np.ndarray, top: Profile, bottom: Profile, half_width: Profile, power: float, taper: float = 0.0
) -> TriangleMesh:
    """A body along x whose cross-sections are superellipses; `taper` narrows them towards the top."""
    phi = np.linspace(0, 2 * np.pi, 65)[:-1]
    across = np.sign(np.cos(phi)) * np.abs(np.cos(phi)) ** (2 / power)
    up = np.sign(np.sin(phi)) * np.abs(np.sin(phi)) ** (2 / power)
    high, low = top(x)[:, None], bottom(x)[:, None]
    y = (high + low) / 2 + (high - low) / 2 * up
    z = half_width(x)[:, None] * across * (1 - taper * (up + 1) / 2)
    return solids.loft(np.stack([np.broadcast_to(x[:, None], y.shape), y, z], axis=-1))


def _rounded(x: np.ndarray, start: float, stop: float, radius: float) -> np.ndarray:
    """1 inside [start, stop], falling like a quarter circle within `radius` of both ends."""
    inside = np.clip(np.minimum(x - start, stop - x) / radius, 0, 1)
    return np.sqrt(1 - (1 - inside) ** 2)


def _stations(start: float, stop: float, radius: float) -> np.ndarray:
    """Positions from start to stop, dense where the ends are rounded."""
    bend = radius * (1 - np.cos(np.linspace(0.15, np.pi / 2, 10)))
    return np.concatenate(
        [start + bend, np.linspace(start + radius, stop - radius, 30)[1:-1], stop - bend[::-1]]
    )


def _wheels(context: Context, xs: tuple[float, float], radius: float, half_width: float) -> list[Part]:
    tyre = solids.lathe(
        [(0.6 * radius, -0.5), (0.9 * radius, -0.5), (radius, -0.35), (radius, 0.35), (0.9 * radius, 0.5),
         (0.6 * radius, 0.5)], 48)  # fmt: skip
    hub = solids.lathe([(0, -0.42), (0.6 * radius, -0.5), (0.6 * radius, 0.5), (0, 0.42)], 48)
    lying = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]]) @ np.diag([1, 0.4 * radius * 2, 1])
    shifts = [(x, radius, side * (half_width - 0.3 * radius)) for x in xs for side in (-1, 1)]
    tyres = solids.join([solids.moved(tyre, lying, s) for s in shifts])
    hubs = solids.join([solids.moved(hub, lying, s) for s in shifts])
    return [
        Part("tyres", tyres, matt(flat(0.04, context.wavelengths))),
        Part("hubs", hubs, _gloss(context, 0.6, 0.2)),
    ]


def _sized(parts: list[Part], length: float) -> list[Part]:
    """The vehicle at its length, about the middle of its bounding box."""
    vertices = np.concatenate([p.mesh.vertices for p in parts])
    centre = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    scale = np.eye(3) * length
    return [Part(p.suffix, solids.moved(p.mesh, scale, -centre * length), p.surface) for p in parts]


class Bus(Builder, Placed):
    """A toy bus that drives to the right; `turn_deg` shows its front."""

    kind: Literal["bus"]
    length_mm: Positive = 60.0
    """length, mm"""
    paint: AnySurface = PlasticSurface(kind="plastic", reflectance="red", roughness=0.1)
    """surface of the paint"""
    sign: str = "36 CITY"
    """text of the destination sign"""

    def build(self, context: Context) -> list[Part]:
        """A city bus: one rounded body, a row of dark windows, a cream band, signs, lamps."""
        w, low, high = 0.125, 0.07, 0.40
        x = _stations(-0.5, 0.5, 0.045)
        body = _body(
            x,
            lambda x: low + (high - low) * (0.9 + 0.1 * _rounded(x, -0.5, 0.5, 0.045)),
            lambda x: low + 0.03 * (1 - _rounded(x, -0.5, 0.5, 0.045)),
            lambda x: w * (0.8 + 0.2 * _rounded(x, -0.5, 0.5, 0.045)),
            power=9,
        )
        windows = [solids.box((0.105, 0.115, 2 * w + 0.004), (-0.405 + 0.124 * i, 0.28, 0)) for i in range(6)]
        door = [solids.box((0.085, 0.225, 2 * w + 0.004), (0.4, 0.225, 0))]
        screens = [
            solids.box((0.01, 0.15, 1.7 * w), (0.4985, 0.265, 0)),
            solids.box((0.01, 0.1, 1.6 * w), (-0.4985, 0.28, 0)),
        ]
        band = solids.box((0.9, 0.022, 2 * w + 0.003), (-0.03, 0.185, 0))
        lamps = [solids.moved(solids.sphere(0.018, 24), shift=(0.494, 0.125, s * 0.085)) for s in (-1, 1)]
        rear = [solids.box((0.01, 0.035, 0.022), (-0.497, 0.14, s * 0.09)) for s in (-1, 1)]
        ink = printing.line_of_text(self.sign, 48, 288)
        black, amber = (reflectance(r, context.wavelengths) for r in (0.03, "orange yellow"))
        sign = matt(mixture(ink, black, amber))
        side_sign = solids.panel(0.3, 0.04, (-0.1, 0.366, -w - 0.0015))
        front_sign = solids.quad(
            [(0.503, 0.35, -0.07), (0.503, 0.35, 0.07), (0.503, 0.375, 0.07), (0.503, 0.375, -0.07)]
        )
        parts = [
            Part("", body, context.surface(self.paint, "paint")),
            Part("windows", solids.join(windows + door + screens), _gloss(context, 0.03)),
            Part("band", band, _gloss(context, "#f2e6c4", 0.15)),
            Part("lamps", solids.join(lamps), _gloss(context, 0.85)),
            Part("rear lamps", solids.join(rear), _gloss(context, "red")),
            Part("sign", solids.join([side_sign, front_sign]), sign),
            *_wheels(context, (-0.29, 0.29), 0.075, w),
        ]
        return _sized(parts, self.length_mm * 1e-3)


class Car(Builder, Placed):
    """A toy car that drives to the right; `turn_deg` shows its front."""

    kind: Literal["car"]
    length_mm: Positive = 60.0
    """length, mm"""
    paint: AnySurface = PlasticSurface(kind="plastic", reflectance="blue", roughness=0.06)
    """surface of the paint"""

    def build(self, context: Context) -> list[Part]:
        """A saloon: a low body, a glass house that narrows upwards, a roof, lamps and bumpers."""
        w = 0.2
        x = _stations(-0.5, 0.5, 0.07)
        waist = np.array(
            [(-0.5, 0.17), (-0.42, 0.215), (-0.28, 0.23), (0.14, 0.225), (0.4, 0.19), (0.5, 0.14)]
        )
        body = _body(
            x,
            lambda x: np.interp(x, *waist.T),
            lambda x: 0.055 + 0.03 * (1 - _rounded(x, -0.5, 0.5, 0.1)),
            lambda x: w * (0.72 + 0.28 * _rounded(x, -0.5, 0.5, 0.16)),
            power=5,
            taper=0.06,
        )
        hump = np.array([(-0.36, 0.215), (-0.24, 0.335), (-0.08, 0.36), (0.04, 0.35), (0.2, 0.215)])
        cabin_x = np.linspace(-0.355, 0.195, 40)

        def roof_line(x: np.ndarray) -> np.ndarray:
            return np.interp(x, *hump.T)

        cabin = _body(
            cabin_x, roof_line, lambda x: np.full_like(x, 0.18), lambda x: np.full_like(x, 0.93 * w), 6, 0.26
        )
        roof = _body(
            np.linspace(-0.235, 0.05, 24),
            lambda x: roof_line(x) + 0.008,
            lambda x: roof_line(x) - 0.014,
            lambda x: np.full_like(x, 0.735 * w),
            5,
        )
        pillar = solids.box((0.022, 0.15, 2 * 0.845 * w), (-0.06, 0.275, 0))
        lamps = [solids.moved(solids.sphere(0.026, 24), shift=(0.47, 0.155, s * 0.125)) for s in (-1, 1)]
        rear = [solids.box((0.02, 0.03, 0.05), (-0.488, 0.175, s * 0.11)) for s in (-1, 1)]
        bumpers = [solids.box((0.03, 0.028, 1.5 * w), (s * 0.497, 0.085, 0)) for s in (-1, 1)]
        paint = context.surface(self.paint, "paint")
        parts = [
            Part("", body, paint),
            Part("glass", cabin, _gloss(context, 0.03)),
            Part("roof", roof, paint),
            Part("pillar", pillar, paint),
            Part("lamps", solids.join(lamps), _gloss(context, 0.85)),
            Part("rear lamps", solids.join(rear), _gloss(context, "red")),
            Part("bumpers", solids.join(bumpers), _gloss(context, 0.3, 0.15)),
            *_wheels(context, (-0.29, 0.3), 0.08, w),
        ]
        return _sized(parts, self.length_mm * 1e-3)
