"""Hard views: radiance, spectrum and size of image."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import torch
from torch import Tensor

from ..capture import Fidelity, capture
from ..errors import InputError
from ..optics import Camera
from ..optics.masks.clear import ClearMask
from ..render.exr import read_view, write_view
from ..render.fragments import Fragments
from ..render.view import View
from .case import Case, Finding, timed
from .measures import distance
from .photos import LAYERED, SHIPPED, HardView, photo_cases
from .true_photos import linear
from .views import (
    MASKS,
    MIDDLE,
    NANOMETRES,
    ROWS,
    WINDOW,
    camera_with,
    flat,
    half,
    uniform,
    with_free_height,
)

BESIDE_LAMPS = 0.02
"""At the worst pixel, where all light is a lamp's: 6e-3 were seen, in the dark rings of its PSF, whose pixels
are integrated from 2 x 2 samples."""


def _scaled(change: Callable[[Tensor], Tensor]) -> HardView:
    view = flat(half(0.4, 1.2))
    return HardView(replace(view, radiance=change(view.radiance)))


def _lamps(change: Callable[[Tensor], Tensor]) -> HardView:
    return replace(_scaled(change), exact=BESIDE_LAMPS)


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


def _line_spectrum() -> HardView:
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


RADIANCE = (
    ("black", "no light at all", "division by the brightest value", lambda: _scaled(torch.zeros_like)),
    ("one band dark", "a band without light", "division by a band's energy", lambda: _scaled(_band_off)),
    (
        "one pixel of 1e6",
        "a lamp seen directly",
        "its light leaks through a transform",
        lambda: _lamps(_one_bright(1e6)),
    ),
    (
        "one pixel of 1e12",
        "the sun in one pixel",
        "its light leaks through a transform",
        lambda: _lamps(_one_bright(1e12)),
    ),
    (
        "faint light",
        "radiance of 1e-30",
        "products that underflow",
        lambda: _scaled(lambda light: light * 1e-30),
    ),
    (
        "bright light",
        "radiance of 1e25",
        "squares that overflow",
        lambda: _scaled(lambda light: light * 1e25),
    ),
    (
        "fireflies",
        "1 % of the pixels ten thousand times too bright",
        "an estimate led astray",
        lambda: _lamps(_fireflies),
    ),
    (
        "contrast 1e5",
        "lamps on black, pixel by pixel",
        "darkness below the rounding of light",
        lambda: _scaled(_contrast),
    ),
)

SPECTRUM = (
    ("mercury", "three lines between the bands", "bands without light", _line_spectrum),
    (
        "one band",
        "monochromatic light",
        "a response of one number",
        lambda: HardView(flat(half(0.4, 1.2), wavelengths=(550.0,))),
    ),
    (
        "two bands",
        "the least that has a spacing",
        "extrapolation from too few",
        lambda: HardView(flat(half(0.4, 1.2), wavelengths=(450.0, 650.0))),
    ),
)

IMAGE = (
    ("one pixel", "1 x 1", "an axis of length 1", lambda: _sized(1, 1, 0.02)),
    ("one row", "1 x 23", "an axis of length 1", lambda: _sized(1, 23)),
    ("one column", "23 x 1", "an axis of length 1", lambda: _sized(23, 1)),
    ("primes", "31 x 37", "transforms of prime length", lambda: _sized(31, 37)),
    ("even", "20 x 24", "half a pixel", lambda: _sized(20, 24)),
)


def _refused(view: View, words: str, window_px: int | None = None) -> Iterator[Finding]:
    """An input that has no photo: one message that holds `words`."""

    def said() -> float:
        try:
            capture(view, camera_with(ClearMask()), Fidelity(window_px=window_px))
        except InputError as error:
            return 0.0 if words in str(error) else 1.0
        return 1.0

    yield timed("layered, message", 0.0, said)


def _outside() -> Iterator[Finding]:
    view = flat(0.5, wavelengths=(380.0, 400.0))
    yield from _refused(view, "nm")


def _smaller_than_psf() -> Iterator[Finding]:
    yield from _refused(flat(0.5, rows=3, columns=3), "wider than the image", window_px=64)


def _storage() -> Iterator[Finding]:
    """A view with a lamp of 1e6 through the file, and a faint one: half floats end at 65504 and at 6e-8."""
    lamp, faint = (flat(half(0.4, 1.2)) for _ in range(2))
    lamp.radiance[:, MIDDLE] = 1e6
    faint.radiance.mul_(1e-30)

    def round_trip(view: View) -> float:
        with TemporaryDirectory() as folder:
            path = Path(folder) / "view.exr"
            write_view(path, Fragments.of(view))
            read = read_view(path).view()
        bright = distance(read.radiance[:, MIDDLE].double(), view.radiance[:, MIDDLE])
        rest = torch.arange(view.pixel.numel()) != MIDDLE
        return max(bright, distance(read.radiance[:, rest].double(), view.radiance[:, rest]))

    yield timed("lamp, half float with an exponent, EXR", 2e-3, lambda: round_trip(lamp))
    yield timed("faint, half float with an exponent, EXR", 2e-3, lambda: round_trip(faint))


def _denormals() -> Iterator[Finding]:
    """Light below the least normal number of float32: what is lost is less than that number."""
    view = flat(half(0.4, 1.2))
    view.radiance.mul_(1e-40)

    def lost(camera: Camera, truth: Tensor) -> float:
        fidelity = Fidelity(occlusion="none").changed(SHIPPED)
        made = capture(view, camera, fidelity, exposure=1.0).clean.double()
        return float((made - truth).abs().max()) / torch.finfo(torch.float32).tiny

    for name, mask in MASKS.items():
        camera = with_free_height(camera_with(mask))
        truth = linear(view, camera)
        measure = partial(lost, camera, truth)
        yield timed(f"layered, {name}, float32, of the least normal number", 1.0, measure)


def _automatic() -> Iterator[Finding]:
    """What the camera chooses itself leaves white at 0.9 where that can be held, and never infinity."""
    camera = camera_with(ClearMask())
    light = flat(half(0.4, 1.2))
    lamp = light.radiance * 1e-30
    lamp[:, MIDDLE] = 1e12
    for way, radiance, white in (
        ("black", 0 * light.radiance, 0.0),
        ("1e-40", light.radiance * 1e-40, None),
        ("1e-30", light.radiance * 1e-30, 0.9),
        ("1e25", light.radiance * 1e25, 0.9),
        ("1e12 on 1e-30", lamp, None),
    ):

        def off(radiance: Tensor = radiance, white: float | None = white) -> float:
            photo = capture(replace(light, radiance=radiance), camera)
            finite = all(bool(torch.isfinite(each).all()) for each in (photo.clean, photo.ideal))
            values = photo.ideal.double().flatten().sort().values
            found = float(values[round(0.995 * (len(values) - 1))])
            return math.nan if not finite else 0.0 if white is None else abs(found - white)

        yield timed(f"{way}, white level", 1e-4, off)


def _negative_lobes() -> Iterator[Finding]:
    """A response that subtracts light, as after a colour matrix, is none of a sensor."""

    def said() -> float:
        with TemporaryDirectory() as folder:
            path = Path(folder) / "lobes.csv"
            path.write_text("wavelength_nm,r,g,b\n400,0,0,1\n550,-0.2,1,0\n700,1,0,0\n")
            try:
                capture(flat(0.5), camera_with(ClearMask(), response=str(path)))
            except InputError as error:
                return 0.0 if "0 or above" in str(error) else 1.0
        return 1.0

    yield timed("message", 0.0, said)


def _wide() -> Iterator[Finding]:
    """A frame 4096 pixels wide equals the photo of its right end alone."""
    columns = 4096
    depth = torch.linspace(0.4, 1.2, columns + 2 * (WINDOW // 2), dtype=torch.float64)
    view = flat(depth.expand(ROWS + 2 * (WINDOW // 2), -1), rows=ROWS, columns=columns)
    keep = 64 + 2 * (WINDOW // 2)
    total = view.padded_shape[1]
    end = view.pixel % total >= total - keep
    part = replace(
        view,
        width=64,
        pixel=torch.arange(int(end.sum())),
        coverage=view.coverage[end],
        inverse_depth=view.inverse_depth[end],
        radiance=view.radiance[:, end],
        hidden=view.hidden[end],
    )
    camera = camera_with(ClearMask())

    fidelity = Fidelity(occlusion="none").changed(SHIPPED)

    def same() -> float:
        whole, alone = (capture(each, camera, fidelity, exposure=1.0).clean for each in (view, part))
        return distance(whole[..., -64:], alone)

    yield timed("layered, its end alone", 0.01, same)


CASES: tuple[Case, ...] = (
    *photo_cases("radiance", "linear in the light", RADIANCE),
    *photo_cases("spectrum", "the response-weighted sum over bands", SPECTRUM),
    *photo_cases("image", "the same as in a larger frame", IMAGE),
    Case(
        "bands outside the response",
        "spectrum",
        "380 and 400 nm alone",
        "a division by no response",
        "one message",
        _outside,
    ),
    Case(
        "response with negative lobes",
        "spectrum",
        "a channel that subtracts light",
        "negative photos",
        "one message",
        _negative_lobes,
    ),
    Case(
        "denormals",
        "radiance",
        "radiance of 1e-40",
        "NaN, or light from nothing",
        "no error above float32's least normal number",
        _denormals,
    ),
    Case(
        "automatic exposure",
        "radiance",
        "a camera exposes what is next to black, or a lamp in the dark",
        "division by no light",
        "white at 0.9, or as bright as can be held",
        _automatic,
    ),
    Case(
        "lamp in storage",
        "radiance",
        "1e6, and 1e-30, in a file of half floats",
        "infinity",
        "kept to half float's digits",
        _storage,
    ),
    Case(
        "smaller than the PSF",
        "image",
        "3 x 3 and a window of 64",
        "wrap-around",
        "one message",
        _smaller_than_psf,
    ),
    Case("4096 wide", "image", "a long frame", "memory, tiles that do not join", "its end alone", _wide),
)
