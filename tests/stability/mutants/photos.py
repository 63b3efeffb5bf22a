"""Broken photos: the sum over fragments, bands and depths, and the photo itself."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import replace

import torch
from hard_cases import light as light_cases
from hard_cases import occlusion, sensor
from torch import Tensor

from edofsim.capture import Photo, blurring, imaging, light, photograph
from edofsim.capture.imaging import Imaging
from edofsim.capture.light import Light
from edofsim.optics import PsfField, field
from edofsim.render.view import View
from edofsim.stability import photos

from .mutant import Mutant, after, scaled, swapped, together

SUMS = ("depth", "spectrum", "image", "coverage")
FRAME = ("depth", "image", "coverage", "radiance")


def _photos(change: Callable[[Tensor], Tensor]) -> Callable[[], AbstractContextManager[object]]:
    """Every photo changed, [.., channel, y, x], the noise-free one too."""

    def changed(photo: Photo) -> Photo:
        return replace(photo, clean=change(photo.clean), image=change(photo.image))

    rooms = (photos, light_cases, occlusion, sensor)
    return lambda: together(*(after(room, "capture", changed) for room in rooms))


def _views(change: Callable[[View], View]) -> Callable[[], AbstractContextManager[object]]:
    """Every view changed right before it is blurred."""
    return lambda: after(Imaging, "light", change)


def _weights(change: Callable[[Tensor], Tensor]) -> Callable[[], AbstractContextManager[object]]:
    """The response [channel, band] changed."""
    return lambda: after(photograph, "channel_weights", change)


def _without_last_band(view: View) -> View:
    shows = torch.ones(view.bands, 1).to(view.radiance)
    shows[-1] = 0
    return replace(view, radiance=view.radiance * shows)


def _without_surroundings(view: View) -> View:
    columns = view.padded_shape[1]
    row, column = view.pixel // columns - view.margin, view.pixel % columns - view.margin
    inside = (row >= 0) & (row < view.height) & (column >= 0) & (column < view.width)
    return replace(view, radiance=view.radiance * inside)


def _small_to_zero(image: Tensor) -> Tensor:
    return torch.where(image < 0.005 * image.max(), 0.0, image)


def _to_nearest_node(found: tuple[Tensor, Tensor]) -> tuple[Tensor, Tensor]:
    return found[0], found[1].round()


def _half_floats(found: Light) -> Light:
    return replace(found, radiance=found.radiance.half().to(found.radiance))


def _first_node(psfs: PsfField) -> PsfField:
    return replace(psfs, source=psfs.values[:1].expand_as(psfs.values))


def _coarse_nodes() -> AbstractContextManager[object]:
    inner = photograph.depth_nodes

    def fewer(depth: Tensor, layers: int | str, slope: float, tolerance_db: float = 50.0) -> Tensor:
        return inner(depth, layers, slope, tolerance_db - 30)

    return swapped(photograph, "depth_nodes", fewer)


def _half_the_slope(bank: PsfField) -> PsfField:
    values = bank.values
    return replace(bank, source=values.detach() + 0.5 * (values - values.detach()))


def _no_glare(found: tuple[Tensor, Tensor]) -> tuple[Tensor, Tensor]:
    return 0 * found[0], found[1]


def _slope_of_light(view: View) -> View:
    radiance = view.radiance
    return replace(view, radiance=0.01 * radiance.detach() + 0.99 * radiance)


def _longer(times: float) -> Callable[[], AbstractContextManager[object]]:
    return lambda: scaled(photograph, "_exposure", times)


def _grey_response(weights: Tensor) -> Tensor:
    return torch.full_like(weights, 1 / weights.shape[1])


def _blurring_of(change: Callable[[Light], Light]) -> Callable[[], AbstractContextManager[object]]:
    return lambda: after(blurring, "light_of", change)


MUTANTS: tuple[Mutant, ...] = (
    Mutant(
        "small values to zero",
        "what is below 0.5 % of a photo's brightest value",
        ("radiance",),
        _photos(_small_to_zero),
    ),
    Mutant("clamped at full scale", "photos end at 1", ("radiance",), _photos(lambda x: x.clamp_max(1))),
    Mutant(
        "photo in float16",
        "lamps beyond 65504 are infinite",
        ("radiance",),
        _photos(lambda x: x.half().to(x)),
    ),
    Mutant("black", "every photo", (*FRAME, "spectrum", "occlusion", "sensor"), _photos(lambda x: 0 * x)),
    Mutant(
        "mirrored frame", "left and right change places", (*FRAME, "occlusion"), _photos(lambda x: x.flip(-1))
    ),
    Mutant("frame upside down", "top and bottom change places", FRAME, _photos(lambda x: x.flip(-2))),
    Mutant("frame one pixel off", "photos one pixel lower", FRAME, _photos(lambda x: x.roll(1, -2))),
    Mutant("photo 1 % brighter", "in all channels", (*FRAME, "sensor"), _photos(lambda x: 1.01 * x)),
    Mutant("red and blue exchanged", "in photos", SUMS, _photos(lambda x: x.flip(-3))),
    Mutant(
        "bands reversed", "the response is read backwards", (*SUMS, "sensor"), _weights(lambda x: x.flip(1))
    ),
    Mutant("channels reversed", "in the response", (*SUMS, "sensor"), _weights(lambda x: x.flip(0))),
    Mutant("no colour", "every channel sees all bands alike", (*SUMS, "sensor"), _weights(_grey_response)),
    Mutant(
        "response one band off",
        "each band counts as its neighbour",
        (*SUMS, "sensor"),
        _weights(lambda x: x.roll(1, 1)),
    ),
    Mutant("one band dropped", "the last one", SUMS, _views(_without_last_band)),
    Mutant("dark surroundings", "no light from beyond the frame", FRAME, _views(_without_surroundings)),
    Mutant(
        "no veiling glare",
        "what leaves the windows is gone",
        FRAME,
        lambda: after(photograph, "glare_of", _no_glare),
    ),
    Mutant(
        "nearest depth",
        "light between two depth nodes goes to the nearer one",
        ("depth", "image"),
        lambda: after(light, "hat_weights", _to_nearest_node),
    ),
    Mutant("few depths", "nodes are chosen for 20 dB", ("depth",), _coarse_nodes),
    Mutant(
        "one PSF for all depths",
        "that of the farthest node",
        ("depth", "coverage"),
        lambda: after(imaging, "psf_field", _first_node),
    ),
    Mutant("light in float16", "as it is blurred", ("radiance",), _blurring_of(_half_floats)),
    Mutant(
        "half the slope by height",
        "gradients that reach the mask",
        ("depth",),
        lambda: after(field, "psf_bank", _half_the_slope),
    ),
    Mutant("slope by light 1 % down", "gradients that reach the view", ("depth",), _views(_slope_of_light)),
    Mutant("exposure 1 % up", "of what is asked for or chosen", ("radiance", "sensor"), _longer(1.01)),
    Mutant("exposure halved", "of what is asked for or chosen", ("radiance", "sensor"), _longer(0.5)),
)
