"""Hard views: radiance, spectrum and size of image."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import torch
from torch import Tensor

from ..optics import Camera
from .photos import LAYERED, HardView, Row
from .views import MIDDLE, NANOMETRES, WINDOW, flat, half, uniform

NEAR_LAMPS = 0.02
"""At the worst pixel, where all light is a lamp's: 6e-3 were seen, in the dark rings of its PSF, whose pixels
are integrated from 2 x 2 samples."""


def _scaled(change: Callable[[Tensor], Tensor]) -> HardView:
    view = flat(half(0.4, 1.2))
    return HardView(replace(view, radiance=change(view.radiance)))


def _lamps(change: Callable[[Tensor], Tensor]) -> HardView:
    return replace(_scaled(change), exact=NEAR_LAMPS)


def _band_off(radiance: Tensor) -> Tensor:
    radiance[2] = 0
    return radiance


def _one_bright(value: float) -> Callable[[Tensor], Tensor]:
    def change(radiance: Tensor) -> Tensor:
        radiance[:, MIDDLE] = value
        return radiance

    return change


def _fireflies(radiance: Tensor) -> Tensor:
    where = uniform(radiance.shape[1], seed=4) < 0.01
    radiance[:, where] *= 1e4
    return radiance


def _contrast(radiance: Tensor) -> Tensor:
    radiance[:, ::2] *= 1e-5
    return radiance


def _line_spectrum(_: Camera) -> HardView:
    """Mercury's lines at 436, 546 and 578 nm lie between the bands: each falls into the band next to it."""
    view = flat(half(0.4, 1.2))
    radiance = torch.zeros_like(view.radiance)
    for line, strength in ((435.8, 1.0), (546.1, 0.9), (578.0, 0.5)):
        nearest = min(range(view.bands), key=lambda band: abs(NANOMETRES[band] - line))
        radiance[nearest] += strength * view.radiance[nearest]
    return HardView(replace(view, radiance=radiance))


def _sized(rows: int, columns: int, layered: float = LAYERED) -> HardView:
    # not linear: a depth exactly between two layers may fall into either, by the rounding of a precision
    along = torch.linspace(0, 1, columns + 2 * (WINDOW // 2), dtype=torch.float64)
    depth = 0.4 + 0.8 * along.square()
    return HardView(
        flat(depth.expand(rows + 2 * (WINDOW // 2), -1), rows=rows, columns=columns), layered=layered
    )


RADIANCE: tuple[Row, ...] = (
    ("black", "no light at all", "division by the brightest value", lambda _: _scaled(torch.zeros_like)),
    ("one band dark", "a band without light", "division by a band's energy", lambda _: _scaled(_band_off)),
    (
        "one pixel of 1e6",
        "a lamp seen directly",
        "its light leaks through a transform",
        lambda _: _lamps(_one_bright(1e6)),
    ),
    (
        "one pixel of 1e12",
        "the sun in one pixel",
        "its light leaks through a transform",
        lambda _: _lamps(_one_bright(1e12)),
    ),
    (
        "faint light",
        "radiance of 1e-30",
        "products that underflow",
        lambda _: _scaled(lambda light: light * 1e-30),
    ),
    (
        "bright light",
        "radiance of 1e25",
        "squares that overflow",
        lambda _: _scaled(lambda light: light * 1e25),
    ),
    (
        "fireflies",
        "1 % of the pixels ten thousand times too bright",
        "an estimate led astray",
        lambda _: _lamps(_fireflies),
    ),
    (
        "contrast 1e5",
        "lamps on black, pixel by pixel",
        "darkness below the rounding of light",
        lambda _: _scaled(_contrast),
    ),
)

SPECTRUM: tuple[Row, ...] = (
    ("mercury", "three lines between the bands", "bands without light", _line_spectrum),
    (
        "one band",
        "monochromatic light",
        "a response of one number",
        lambda _: HardView(flat(half(0.4, 1.2), wavelengths=(550.0,))),
    ),
    (
        "two bands",
        "the least that has a spacing",
        "extrapolation from too few",
        lambda _: HardView(flat(half(0.4, 1.2), wavelengths=(450.0, 650.0))),
    ),
)

IMAGE: tuple[Row, ...] = (
    ("one pixel", "1 x 1", "an axis of length 1", lambda _: _sized(1, 1, 0.02)),
    ("one row", "1 x 23", "an axis of length 1", lambda _: _sized(1, 23)),
    ("one column", "23 x 1", "an axis of length 1", lambda _: _sized(23, 1)),
    ("primes", "31 x 37", "transforms of prime length", lambda _: _sized(31, 37)),
    ("even", "20 x 24", "half a pixel", lambda _: _sized(20, 24)),
)
