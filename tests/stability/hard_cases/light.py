"""Hard light without a photo written out: bands, files and frames that are refused or kept, exposure."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import torch
from torch import Tensor

from edofsim.capture import Fidelity, capture
from edofsim.errors import InputError
from edofsim.optics import Camera
from edofsim.optics.masks.clear import ClearMask
from edofsim.render.exr import read_view, write_view
from edofsim.render.view import View
from edofsim.stability.case import Case, Finding, timed
from edofsim.stability.measures import distance
from edofsim.stability.photos import SHIPPED
from edofsim.stability.true_photos import linear
from edofsim.stability.views import MASKS, MIDDLE, ROWS, WINDOW, camera_with, flat, half, with_free_height

from .written_photos import WRITTEN_OUT


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
            write_view(path, view.fragments())
            read = View.of(read_view(path))
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
        truth = linear(view, camera, WRITTEN_OUT)
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
