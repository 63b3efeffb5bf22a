"""The hard views: depth, coverage, radiance, spectrum and size of image."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import torch
from torch import Tensor

from ...errors import InputError
from ...expose import expose
from ...optics import focus_distance
from ...recipe.masks import ClearMask
from ...render.exr import read_view, write_view
from .case import Case, Finding, timed
from .photos import (
    COLUMNS,
    LAYERED,
    METHODS,
    NANOMETRES,
    QUIET,
    ROWS,
    SINGLE,
    WINDOW,
    HardView,
    camera_with,
    distance,
    flat,
    layered_view,
    photo_case,
    uniform,
)

PADDED = (ROWS + 2 * (WINDOW // 2), COLUMNS + 2 * (WINDOW // 2))
LAMP_SINGLE = 3e-4
"""Factored PSFs are factored anew in each precision, to a tolerance for whole images; a lamp alone shows the
difference of a single one."""
ONE_DEPTH = (*METHODS, "constant")


def _in_focus() -> float:
    return 1 / float(focus_distance(camera_with(ClearMask()), 550e-9))


def _columns(values: Tensor) -> Tensor:
    """Values [x] of the padded frame for each of its rows."""
    return values.expand(PADDED)


def _half(left: float, right: float) -> Tensor:
    """Two values side by side, a step between two pixels of the frame."""
    return _columns(torch.where(torch.arange(PADDED[1]) < PADDED[1] // 2, left, right).double())


def _one_outlier() -> Tensor:
    depth = torch.full(PADDED, 0.5, dtype=torch.float64)
    depth[PADDED[0] // 2, PADDED[1] // 2] = 10.0
    return depth


def _scaled(change: Callable[[Tensor], Tensor], single: float = SINGLE) -> HardView:
    view = flat(_half(0.4, 1.2))
    return HardView(replace(view, radiance=change(view.radiance)), single=single)


def _band_off(radiance: Tensor) -> Tensor:
    radiance[2] = 0
    return radiance


def _one_bright(value: float) -> Callable[[Tensor], Tensor]:
    def change(radiance: Tensor) -> Tensor:
        radiance[:, radiance.shape[1] // 2] = value
        return radiance

    return change


def _fireflies(radiance: Tensor) -> Tensor:
    where = uniform(radiance.shape[1], seed=4) < 0.01
    radiance[:, where] *= 1e4
    return radiance


def _contrast(radiance: Tensor) -> Tensor:
    radiance[:, ::2] *= 1e-5
    return radiance


def _wires() -> HardView:
    """A hundred wires a tenth of a pixel thick, at as many depths, in front of a wall."""
    base = flat(0.2)
    count = base.pixel.numel()
    wired = torch.arange(count)[torch.arange(count) % 3 == 0]
    depth = torch.linspace(0.5, 2.0, 100, dtype=torch.float64)[torch.arange(len(wired)) % 100]
    thick = 0.1
    radiance = base.radiance.clone()
    radiance[:, wired] *= 1 - thick
    coverage = base.coverage.clone()
    coverage[wired] -= thick
    pixel = torch.cat([wired, base.pixel, wired])
    order = torch.argsort(
        3 * pixel + torch.cat([torch.zeros_like(wired), torch.ones_like(base.pixel), 2 + 0 * wired])
    )
    wires = thick * uniform(base.bands, len(wired), seed=6)
    behind = base.radiance[:, wired] * thick
    return HardView(
        replace(
            base,
            pixel=pixel[order],
            coverage=torch.cat([torch.full_like(depth, thick), coverage, torch.full_like(depth, thick)])[
                order
            ],
            inverse_depth=torch.cat([depth, base.inverse_depth, base.inverse_depth[wired]])[order],
            radiance=torch.cat([wires, radiance, behind], 1)[:, order],
            hidden=torch.cat(
                [torch.zeros_like(wired), torch.zeros_like(base.pixel), torch.ones_like(wired)]
            ).bool()[order],
        )
    )


def _sum_above_one() -> HardView:
    view = layered_view(_half(0.5, 0.5), 1.2, 0.4)
    return HardView(replace(view, coverage=view.coverage * (1 + 1e-6)))


def _line_spectrum() -> HardView:
    """Mercury's lines at 436, 546 and 578 nm lie between the bands: each falls into the band next to it."""
    view = flat(_half(0.4, 1.2))
    radiance = torch.zeros_like(view.radiance)
    for line, strength in ((435.8, 1.0), (546.1, 0.9), (578.0, 0.5)):
        nearest = min(range(view.bands), key=lambda band: abs(NANOMETRES[band] - line))
        radiance[nearest] += strength * view.radiance[nearest]
    return HardView(replace(view, radiance=radiance))


def _sized(rows: int, columns: int, layered: float = LAYERED) -> HardView:
    # not linear: a depth exactly between two layers may fall into either, by the rounding of a precision
    along = torch.linspace(0, 1, columns + 2 * (WINDOW // 2), dtype=torch.float64)
    depth = 0.4 + 0.8 * along.square()
    return HardView(flat(depth.expand(rows + 2 * (WINDOW // 2), -1), rows=rows, columns=columns), layered)


DEPTH = (
    (
        "infinity",
        "all light is parallel: 1/z = 0",
        "division by depth",
        lambda: HardView(flat(0.0), methods=ONE_DEPTH),
    ),
    (
        "a million kilometres",
        "z = 1e9 m, next to infinity",
        "1/z lost in a sum",
        lambda: HardView(flat(1e-9)),
    ),
    (
        "in focus for one band",
        "550 nm is sharp: its geometric blur is 0, others are not",
        "a blur of width 0",
        lambda: HardView(flat(_in_focus()), methods=ONE_DEPTH),
    ),
    (
        "five centimetres",
        "20 dioptres: most light leaves the window",
        "phase beyond the sampling",
        lambda: HardView(flat(20.0)),
    ),
    (
        "one depth",
        "nothing but a convolution is called for",
        "layers where none are",
        lambda: HardView(flat(1.0), methods=ONE_DEPTH),
    ),
    (
        "one micrometre apart",
        "two surfaces whose 1/z differs by 1e-6",
        "division by the distance of two nodes",
        lambda: HardView(flat(_half(1.0, 1 / (1 + 1e-6)))),
    ),
    (
        "half a metre to infinity",
        "the largest step that there is, within a pixel",
        "ringing between nodes",
        lambda: HardView(flat(_half(2.0, 0.0))),
    ),
    (
        "slanted through focus",
        "blur falls to nothing and grows again",
        "focus between two nodes",
        lambda: HardView(flat(_columns(torch.linspace(0.2, 1.2, PADDED[1], dtype=torch.float64)))),
    ),
    (
        "empty layers",
        "two depths and nine layers",
        "0 / 0 in a layer without light",
        lambda: HardView(flat(_half(0.3, 1.5)), options={"layers": 9}),
    ),
    (
        "layers of one column",
        "every column has its own depth",
        "layers that hold a single pixel",
        # white noise at 35 depths is as far from the natural images of the tolerance as a view can be
        lambda: HardView(
            flat(_columns(torch.linspace(0.0, 2.0, PADDED[1], dtype=torch.float64))), layered=0.02
        ),
    ),
    (
        "one outlier",
        "one pixel at 0.1 m, all others at 2 m",
        "all layers spent on one pixel",
        lambda: HardView(flat(_one_outlier())),
    ),
    (
        "more layers than depths",
        "three depths and forty layers",
        "nodes that coincide",
        lambda: HardView(
            flat(_columns((torch.arange(PADDED[1]) % 3).double() * 0.5)), options={"layers": 40}
        ),
    ),
)

COVERAGE = (
    (
        "coverage 0",
        "fragments that cover nothing",
        "0 / 0 where light is divided by coverage",
        lambda: HardView(layered_view(_half(0.0, 0.0), 1.2, 0.4)),
    ),
    (
        "coverage 1",
        "the front covers all: nothing of the back is seen",
        "1 / (1 - 1)",
        lambda: HardView(layered_view(_half(1.0, 1.0), 1.2, 0.4)),
    ),
    (
        "coverage 1 and hidden light",
        "all that the blur uncovers is hidden",
        "1 / (1 - 1)",
        lambda: HardView(layered_view(_half(1.0, 0.0), 1.2, 0.4, 1.0)),
    ),
    (
        "coverage 1e-7",
        "a hair thinner than single precision",
        "cancellation in 1 - a",
        lambda: HardView(layered_view(_half(1e-7, 1 - 1e-7), 1.2, 0.4, 1.0)),
    ),
    ("coverage above 1", "fragments that sum to 1 + 1e-6", "negative light behind", _sum_above_one),
    ("a hundred wires", "thin things at a hundred depths", "products of a hundred factors", _wires),
    (
        "hidden nearer than the gap",
        "a hidden surface that lies 1 mm behind the visible one",
        "an edge where there is none",
        lambda: HardView(layered_view(_half(1.0, 0.0), 1.0, 0.999, 1.0)),
    ),
    (
        "hidden coverage 1e-7",
        "next to nothing is known of what is behind",
        "division by what was found",
        lambda: HardView(layered_view(_half(1.0, 0.0), 1.2, 0.4, 1e-7)),
    ),
    (
        "half covered everywhere",
        "an edge in every pixel",
        "no pixel is far from an edge",
        lambda: HardView(layered_view(_half(0.5, 0.5), 1.2, 0.4, 0.5)),
    ),
)

RADIANCE = (
    ("black", "no light at all", "division by the brightest value", lambda: _scaled(torch.zeros_like)),
    ("one band dark", "a band without light", "division by a band's energy", lambda: _scaled(_band_off)),
    (
        "one pixel of 1e6",
        "a lamp seen directly",
        "its light leaks through a transform",
        lambda: _scaled(_one_bright(1e6), LAMP_SINGLE),
    ),
    (
        "one pixel of 1e12",
        "the sun in one pixel",
        "its light leaks through a transform",
        lambda: _scaled(_one_bright(1e12), LAMP_SINGLE),
    ),
    (
        "denormal light",
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
        lambda: _scaled(_fireflies),
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
        lambda: HardView(flat(_half(0.4, 1.2), wavelengths=(550.0,))),
    ),
    (
        "two bands",
        "the least that has a spacing",
        "extrapolation from too few",
        lambda: HardView(flat(_half(0.4, 1.2), wavelengths=(450.0, 650.0))),
    ),
)

IMAGE = (
    ("one pixel", "1 x 1", "an axis of length 1", lambda: _sized(1, 1, 0.02)),
    ("one row", "1 x 23", "an axis of length 1", lambda: _sized(1, 23)),
    ("one column", "23 x 1", "an axis of length 1", lambda: _sized(23, 1)),
    ("primes", "31 x 37", "transforms of prime length", lambda: _sized(31, 37)),
    ("even", "20 x 24", "half a pixel", lambda: _sized(20, 24)),
)


def _refused(view: object, words: str, **options: object) -> Iterator[Finding]:
    """An input that has no photo: one message that holds `words`, from every method."""
    for method in METHODS:

        def said(method: str = method) -> float:
            try:
                expose(view, camera_with(ClearMask()), method=method, effects=QUIET, **options)
            except InputError as error:
                return 0.0 if words in str(error) else 1.0
            return 1.0

        yield timed(f"{method}, message", 0.0, said)


def _outside() -> Iterator[Finding]:
    view = flat(0.5, wavelengths=(380.0, 400.0))
    yield from _refused(view, "nm")


def _smaller_than_psf() -> Iterator[Finding]:
    yield from _refused(flat(0.5, rows=3, columns=3), "wider than the image", window_px=64)


def _storage() -> Iterator[Finding]:
    """A view with a lamp of 1e6 through the file: half floats end at 65504."""
    view = flat(_half(0.4, 1.2))
    view.radiance[:, 40] = 1e6

    def round_trip() -> float:
        with TemporaryDirectory() as folder:
            path = Path(folder) / "view.exr"
            write_view(path, view)
            read = read_view(path)
        bright = distance(read.radiance[:, 40].double(), view.radiance[:, 40])
        rest = torch.arange(view.pixel.numel()) != 40
        return max(bright, distance(read.radiance[:, rest].double(), view.radiance[:, rest]))

    yield timed("half float with an exponent, EXR", 2e-3, round_trip)


def _negative_lobes() -> Iterator[Finding]:
    """A response that subtracts light, as after a colour matrix, is none of a sensor."""

    def said() -> float:
        with TemporaryDirectory() as folder:
            path = Path(folder) / "lobes.csv"
            path.write_text("wavelength_nm,r,g,b\n400,0,0,1\n550,-0.2,1,0\n700,1,0,0\n")
            try:
                expose(flat(0.5), camera_with(ClearMask(), response=str(path)), effects=QUIET)
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

    def same() -> float:
        whole, alone = (
            expose(each, camera, method="brute", occlusion="none", exposure=1.0, effects=QUIET).clean
            for each in (view, part)
        )
        return distance(whole[..., -64:], alone)

    yield timed("brute, float32", 0.01, same)


def _table(group: str, expected: str, rows: tuple) -> tuple[Case, ...]:
    return tuple(photo_case(name, group, physics, risk, expected, make) for name, physics, risk, make in rows)


CASES: tuple[Case, ...] = (
    *_table("depth", "each fragment's own PSF, added up", DEPTH),
    *_table("coverage", "as much light as there is, finite derivatives", COVERAGE),
    *_table("radiance", "linear in the light", RADIANCE),
    *_table("spectrum", "the response-weighted sum over bands", SPECTRUM),
    *_table("image", "the same as in a larger frame", IMAGE),
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
        "lamp in storage",
        "radiance",
        "1e6 in a file of half floats",
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
