"""Views as spectral OpenEXR files.

One file holds a view, in two parts.

Part `image` is what the pinhole sees, in the layout of A. Fichet, R. Pacanowski, A. Wilkie, An OpenEXR layout
for spectral images, JCGT 10(3), 2021: a half-float channel a band (`S0.420,000000nm`), attributes
`spectralLayoutVersion`, `emissiveUnits`, and `EV`: radiance is the stored number times 2^EV, 0 unless the
radiance would leave half float's range. Channel `Z` (float) is the camera-space depth in metres, infinite for
the background; in a pixel that sees several surfaces it is the harmonic mean. The display window is the
frame, the data window the frame with its margin.

Part `fragments` lists the fragments of all pixels but those that see exactly one surface and have nothing
hidden behind it. It is a table written as an image, row by row: `pixel` (uint, counts in the data window from
its top left; unused cells at the end hold 2^32 - 1), `coverage`, `inverseDepth` (1/m), `hidden` (0 or 1) and
the same spectral channels, premultiplied by coverage.

Part `noise` holds half of what two independent halves of the samples differ by, in channels alike that are
called `D0.420,000000nm`, of all that a pixel sees; the table has the same channels of its fragments. It has
an `EV` of its own, and two bits of mantissa alone: enough for its variance, to 0.3 %, and small when
compressed. Views that were not made of samples, and files of earlier versions, have no such part.

Attribute `edofsim` is JSON: what a `View` says of itself. Bytes follow from the view alone.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..core.images import openexr, save_exr
from ..core.json_values import Json
from .fragments import Fragments

if TYPE_CHECKING:
    import OpenEXR

LARGEST = 30000.0
"""Stored numbers stay below this; half float ends at 65504."""

SMALLEST_PEAK = 2.0**-6
"""If the brightest number is below this, it is scaled up: half float loses digits below 6e-5."""

EMPTY = 0xFFFFFFFF
TABLE_WIDTH = 256
FORMAT = 1


def channel_name(wavelength: float) -> str:
    """Name of a band's channel: `S0.420,000000nm` for 420e-9 m."""
    return f"S0.{wavelength * 1e9:.6f}nm".replace(".", ",").replace("S0,", "S0.", 1)


def exposure_value(radiance: np.ndarray) -> float:
    """EV that brings radiances into half float's range; 0 if they are in it.

    radiance: any shape [...].
    """
    peak = float(radiance.max()) if radiance.size else 0.0
    if SMALLEST_PEAK <= peak <= LARGEST or not peak > 0:
        return 0.0
    return float(np.ceil(np.log2(peak / LARGEST)))


def noise_name(wavelength: float) -> str:
    """Name of a band's channel of noise: `D0.420,000000nm` for 420e-9 m."""
    return "D" + channel_name(wavelength)[1:]


def coarsely(noise: np.ndarray) -> tuple[np.ndarray, float]:
    """Noise of any shape as float16 with two bits of mantissa, and the EV that it was divided by.

    noise: any shape [...].
    """
    peak = float(np.abs(noise).max()) if noise.size else 0.0
    value = float(np.ceil(np.log2(peak / LARGEST))) if peak > 0 else 0.0
    bits = (noise * np.float32(2.0**-value)).astype(np.float16).view(np.uint16)
    return ((bits + 0x80) & 0xFF00).astype(np.uint16).view(np.float16), value


def _about(view: Fragments) -> Json:
    """What a file says of a view in addition to its fragments."""
    return {
        "format": FORMAT,
        "pixel_angle": view.pixel_angle,
        "noise": view.noise,
        "wavelengths_m": view.wavelengths.tolist(),
        "metadata": {key: value for key, value in view.metadata.items() if key != "run"},
        **({} if view.axis is None else {"axis": view.axis}),
    }


def write_view(path: Path, view: Fragments, recipe: Json | None = None) -> Callable[[], Fragments]:
    """Write a view, and return what gives it as `read_view` does.

    recipe: JSON-able, stored as an attribute.

    Raises OSError if the file cannot be written.
    """
    writer = openexr()
    rows, columns = view.padded_shape
    value = exposure_value(view.radiance)
    names = [channel_name(w) for w in view.wavelengths.tolist()]
    scale = 2.0**-value
    image = (view.all_in_focus() * np.float32(scale)).astype(np.float16)
    noise = None if view.half_difference is None else coarsely(view.half_difference)
    with np.errstate(divide="ignore"):
        depth = (1 / view.mean_inverse_depth()).astype(np.float32)
    spectral = {
        "spectralLayoutVersion": "1.0",
        "emissiveUnits": "W.m^-2.sr^-1",
        "EV": value,
        "compression": writer.ZIP_COMPRESSION,
        "type": writer.scanlineimage,
    }
    margin = view.margin
    window = (
        np.array([-margin, -margin], np.int32),
        np.array([columns - margin - 1, rows - margin - 1], np.int32),
    )
    frame = (np.zeros(2, np.int32), np.array([view.width - 1, view.height - 1], np.int32))
    header = {
        **spectral,
        "dataWindow": window,
        "displayWindow": frame,
        "edofsim": json.dumps(_about(view), sort_keys=True),
        "recipe": json.dumps(recipe or {}, sort_keys=True),
    }
    channels = {name: np.ascontiguousarray(image[band]) for band, name in enumerate(names)}
    parts = [writer.Part(header, {**channels, "Z": depth}, "image")]
    listed = _listed(view)
    table = _table(view, listed, names, scale)
    seen_noise = None
    if noise is not None:
        coarse = replace(view, radiance=noise[0].astype(np.float32))
        seen_noise = coarse.all_in_focus().astype(np.float16)
        table |= {
            noise_name(w): _cells(row[listed]) for w, row in zip(view.wavelengths, noise[0], strict=True)
        }
    size = (np.zeros(2, np.int32), np.array(table["pixel"].shape[::-1], np.int32) - 1)
    # All parts of a file share their display window.
    parts.append(
        writer.Part({**spectral, "dataWindow": size, "displayWindow": frame}, {**table}, "fragments")
    )
    if noise is not None and seen_noise is not None:
        about_noise = {"EV": noise[1], "compression": writer.ZIP_COMPRESSION, "type": writer.scanlineimage}
        about_noise |= {"dataWindow": window, "displayWindow": frame}
        bands = {noise_name(w): row for w, row in zip(view.wavelengths.tolist(), seen_noise, strict=True)}
        parts.append(writer.Part(about_noise, bands, "noise"))
    save_exr(writer.File(parts), path)
    differing = None if noise is None or seen_noise is None else (seen_noise, noise[1])
    return partial(_view_from, json.loads(header["edofsim"]), value, image, depth, table, margin, differing)


def _listed(view: Fragments) -> np.ndarray:
    """Which fragments the table holds, bool [fragment]: those of pixels with more than one."""
    rows, columns = view.padded_shape
    count = np.bincount(view.pixel, minlength=rows * columns)
    return (count[view.pixel] > 1) | view.hidden | (view.coverage != 1)


def _table(view: Fragments, listed: np.ndarray, names: list[str], scale: float) -> dict[str, np.ndarray]:
    radiance = (view.radiance[:, listed] * np.float32(scale)).astype(np.float16)
    return {
        "pixel": _cells(view.pixel[listed].astype(np.uint32), EMPTY),
        "coverage": _cells(view.coverage[listed].astype(np.float32)),
        "inverseDepth": _cells(view.inverse_depth[listed].astype(np.float32)),
        "hidden": _cells(view.hidden[listed].astype(np.uint32)),
        **{name: _cells(radiance[band]) for band, name in enumerate(names)},
    }


def _cells(values: np.ndarray, filler: float = 0) -> np.ndarray:
    """A column of the table, as an image."""
    height = max(1, -(-len(values) // TABLE_WIDTH))
    out = np.full(height * TABLE_WIDTH, filler, values.dtype)
    out[: len(values)] = values
    return out.reshape(height, TABLE_WIDTH)


def read_view(path: Path) -> Fragments:
    """Read a view that `write_view` wrote.

    Raises ValueError, with the reason, for a file that is damaged, or not a view of ours.
    """
    try:
        return _view_of(openexr().File(str(path), separate_channels=True))
    except (RuntimeError, LookupError, TypeError, ValueError, AttributeError, ArithmeticError) as error:
        raise ValueError(f"{path} is not a readable view: {error}") from error


def _view_of(file: OpenEXR.File) -> Fragments:
    """The view in an open file; any kind of error for one that is damaged."""
    image, table, *rest = file.parts
    header = image.header
    about = json.loads(header["edofsim"])
    if about["format"] != FORMAT:
        raise ValueError(f"it has layout {about['format']}, and this version reads {FORMAT}")
    names = [channel_name(w) for w in about["wavelengths_m"]]
    noise = None
    if rest:
        bands = [rest[0].channels[noise_name(w)].pixels for w in about["wavelengths_m"]]
        noise = np.stack(bands), float(rest[0].header["EV"])
    return _view_from(
        about,
        float(header["EV"]),
        np.stack([image.channels[name].pixels for name in names]),
        image.channels["Z"].pixels,
        {name: channel.pixels for name, channel in table.channels.items()},
        -int(header["dataWindow"][0][0]),
        noise,
    )


def _view_from(
    about: Json,
    exposure: float,
    image: np.ndarray,
    depth: np.ndarray,
    table: Mapping[str, np.ndarray],
    margin: int,
    noise: tuple[np.ndarray, float] | None = None,
) -> Fragments:
    """The view of what a file holds: image, float16 [band, y, x], stored radiance; exposure: its EV; depth,
    float32 [y, x] in metres; table: of fragments, by channel; about: what the view says of itself; noise:
    what part `noise` holds, float16 [band, y, x], and its EV."""
    wavelengths = np.array(about["wavelengths_m"], np.float64)
    cells = {name: values.reshape(-1) for name, values in table.items()}
    used = np.flatnonzero(cells["pixel"] != EMPTY)
    listed = cells["pixel"][used].astype(np.int64)
    rows, columns = depth.shape
    if not 0 <= 2 * margin < min(rows, columns):
        raise ValueError(f"its margin of {margin} pixels does not fit its {columns} x {rows}")
    plain = np.ones(rows * columns, bool)
    plain[listed] = False
    alone = np.flatnonzero(plain)
    pixel = np.concatenate([alone, listed])
    inverse_depth = np.concatenate([1 / depth.reshape(-1)[alone], cells["inverseDepth"][used]])
    hidden = np.concatenate([np.zeros(len(alone), bool), cells["hidden"][used] != 0])
    coverage = np.concatenate([np.ones(len(alone), np.float32), cells["coverage"][used]])
    order = np.lexsort((hidden, -inverse_depth, pixel))

    def light(image: np.ndarray, exposure: float, name: Callable[[float], str]) -> np.ndarray:
        out = np.empty((len(image), len(order)), np.float32)
        for band, (seen, wavelength) in enumerate(zip(image, wavelengths.tolist(), strict=True)):
            some = seen.reshape(-1)[alone], cells[name(wavelength)][used]
            out[band] = np.concatenate(some).astype(np.float32)[order]
        if exposure:
            out *= 2.0**exposure
        return out

    return Fragments(
        height=rows - 2 * margin,
        width=columns - 2 * margin,
        margin=margin,
        pixel=pixel[order],
        coverage=coverage[order],
        inverse_depth=inverse_depth[order].astype(np.float32),
        radiance=light(image, exposure, channel_name),
        hidden=hidden[order],
        wavelengths=wavelengths,
        pixel_angle=about["pixel_angle"],
        noise=about["noise"],
        metadata=about["metadata"],
        half_difference=None if noise is None else light(*noise, noise_name),
        axis=None if about.get("axis") is None else tuple(about["axis"]),
    )
