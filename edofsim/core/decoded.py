"""PNG, JPEG, TIFF and their like, decoded to the numbers that they mean.

A file says more than its numbers: how it was held when it was taken (Exif 2.32, tag 0x0112), what its colours
are relative to (ICC profile, gamma), what is transparent. What is obeyed is said in a line.
"""

from __future__ import annotations

import io
import logging
import math
import re
import struct
import warnings
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np
import tifffile
from PIL import Image, ImageCms, ImageOps

from ..errors import InputError, first_line
from .limits import check_numbers, check_pixels, existing

if TYPE_CHECKING:
    from tifffile import TiffPage

FORMATS = ("PNG", "JPEG", "TIFF", "BMP", "GIF", "WEBP", "PPM", "TGA", "JPEG2000")
"""What is opened, by Pillow's names; others run programs of their own, as EPS does."""
TIFF_BEGINS = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
PNG_BEGINS = b"\x89PNG\r\n\x1a\n"
PNG_CHANNELS = {2: 3, 4: 2, 6: 4}
"""Of the colour types that Pillow shortens: RGB, grey with opacity, RGB with opacity."""
ORIENTATION, GDAL_NODATA = 274, 42113
SRGB_GAMMA = 0.45455
PHOTOMETRIC_WHITE_IS_ZERO, PHOTOMETRIC_PLAIN = 0, (0, 1, 2)
EXTRA_ALPHA = (1, 2)

TURNS: dict[int, Callable[[np.ndarray], np.ndarray]] = {
    2: lambda a: a[:, ::-1],
    3: lambda a: a[::-1, ::-1],
    4: lambda a: a[::-1],
    5: lambda a: a.swapaxes(0, 1),
    6: lambda a: np.rot90(a, -1),
    7: lambda a: a.swapaxes(0, 1)[::-1, ::-1],
    8: lambda a: np.rot90(a),
}
"""What makes an array [y, x, ...] upright, by its orientation."""


@dataclass(frozen=True)
class Decoded:
    """Numbers of a file, upright, and what was done to get them.

    values: [y, x] or [y, x, channel], of the file's own type; the last of 2 or 4 channels is opacity.
    gamma: exponent of the transfer curve where the file states another than that of sRGB.
    said: a phrase for each thing that the file says and that was obeyed, or could not be.
    """

    values: np.ndarray
    gamma: float | None = None
    said: tuple[str, ...] = ()


def read_picture(path: Path, what: str) -> np.ndarray:
    """The values of `decoded`, for colours."""
    return decoded(path, what).values


def decoded(path: Path, what: str, *, measured: bool = False) -> Decoded:
    """A picture file as an array, upright.

    measured: the numbers are no colours: colour profiles are left alone, and values that are not finite are
        legal.

    Raises InputError for what is missing, too large, damaged, animated or no picture.
    """
    existing(path, what)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # sizes are checked below, and what else matters is said
        try:
            found = _opened(path, what, measured)
        except InputError:
            raise
        except Image.DecompressionBombError:
            raise InputError(f"{what}: {str(path)!r} has too many pixels to read; scale it down") from None
        except Exception as error:  # the readers raise nearly anything
            raise InputError(_unreadable(path, what, error)) from error
    values = found.values
    if values.ndim not in (2, 3) or values.size == 0 or values.dtype.kind not in "buif":
        raise InputError(f"{what}: {str(path)!r} holds an array of shape {values.shape}, not one picture")
    if not measured and values.dtype.kind == "f" and not np.isfinite(values).all():
        raise InputError(f"{what}: {str(path)!r} holds values that are not finite")
    return replace(found, values=np.ascontiguousarray(values))


def _unreadable(path: Path, what: str, error: Exception) -> str:
    if path.suffix.lower() in (".heic", ".heif", ".avif"):
        return f"{what}: {str(path)!r} is HEIC or AVIF, which is not read; save it as JPEG or PNG"
    reason = "it is of no kind that is read" if isinstance(error, Image.UnidentifiedImageError) else None
    return (
        f"{what}: {str(path)!r} is not a picture that can be read (PNG, JPEG, TIFF, BMP, GIF, WebP): "
        f"{reason or first_line(error)}"
    )


def _opened(path: Path, what: str, measured: bool) -> Decoded:
    with path.open("rb") as file:
        tiff = file.read(4) in TIFF_BEGINS
    if tiff:
        found = _tiff(path, what, measured)
        if found is not None:
            return found
    Image.init()  # else Pillow knows the most usual kinds alone
    with Image.open(path, formats=FORMATS) as image:
        columns, rows = image.size
        check_pixels(rows, columns, path, what)
        frames = getattr(image, "n_frames", 1)
        if frames > 1 and image.format != "MPO":
            raise InputError(f"{what}: {str(path)!r} holds {frames} pictures; save the one that you mean")
        return _by_pillow(image, path, measured)


def _by_pillow(image: Image.Image, path: Path, measured: bool) -> Decoded:
    said: list[str] = []
    if image.format == "MPO":
        said.append("the first of its pictures")
    info: Mapping[object, object] = {**image.info}
    orientation = image.getexif().get(ORIENTATION, 1)
    sixteen = _sixteen_bits(image, path)
    icc = image.info.get("icc_profile")
    image.load()
    upright = ImageOps.exif_transpose(image)
    if orientation in TURNS:
        said.append(f"turned upright (Exif orientation {orientation})")
    known, gamma = _in_known_colours(upright, icc, info, measured, said)
    values = np.asarray(known)
    whole = read_16_bits(path) if sixteen and known is upright else None
    if whole is not None:
        values = TURNS[orientation](whole) if orientation in TURNS else whole
    elif sixteen:
        said.append("8 of its 16 bits")
    return Decoded(values.astype(values.dtype.newbyteorder("=")), gamma, tuple(said))


def _sixteen_bits(image: Image.Image, path: Path) -> bool:
    """Whether a file of colours has 16 bits a channel, of which Pillow keeps 8."""
    with path.open("rb") as file:
        head = file.read(256)
    if image.format == "PNG":
        return image.mode in ("LA", "RGB", "RGBA") and head[24] == 16
    largest = re.match(rb"P6(?:\s+|#[^\n]*\n)+\d+\s+\d+\s+(\d+)", head)
    return largest is not None and int(largest[1]) > 255


def _in_known_colours(
    image: Image.Image, icc: bytes | None, info: Mapping[object, object], measured: bool, said: list[str]
) -> tuple[Image.Image, float | None]:
    """The picture in grey or sRGB, with opacity last; and the exponent that a PNG states."""
    mode = image.mode
    if mode in ("P", "PA"):
        image = image.convert("RGBA" if "transparency" in info or mode == "PA" else "RGB")
        said.append("colours of its palette")
    elif "transparency" in info and mode in ("L", "RGB", "1"):
        image = image.convert("RGBA")
    elif mode in ("La", "RGBa"):
        image = image.convert({"La": "LA", "RGBa": "RGBA"}[mode])
    if not measured and icc and image.mode in ("L", "LA", "RGB", "RGBA", "CMYK", "LAB"):
        return _by_profile(image, icc, said), None
    if not measured and icc:
        said.append("its colour profile is not used")
    if image.mode in ("CMYK", "YCbCr", "HSV", "LAB", "RGBX"):
        said.append(f"{image.mode} without a profile, as sRGB")
        image = image.convert("RGB")
    gamma = info.get("gamma")
    if measured or not isinstance(gamma, int | float) or not gamma > 0 or "srgb" in info:
        return image, None
    if abs(gamma / SRGB_GAMMA - 1) < 0.02:
        return image, None
    said.append(f"gamma {gamma:g} that the file states")
    return image, 1 / float(gamma)


def _by_profile(image: Image.Image, icc: bytes, said: list[str]) -> Image.Image:
    """The picture in sRGB, by its own colour profile; CMYK that has none that can be used by Pillow's
    rule."""
    opacity = image.getchannel("A") if image.mode in ("LA", "RGBA") else None
    plain = image.convert(image.mode.removesuffix("A")) if opacity is not None else image
    try:
        profile = ImageCms.ImageCmsProfile(io.BytesIO(icc))
        name = ImageCms.getProfileDescription(profile).strip() or "without a name"
        if "srgb" in name.lower() and plain.mode == "RGB":
            return image
        turned = ImageCms.profileToProfile(plain, profile, ImageCms.createProfile("sRGB"), outputMode="RGB")
        said.append(f"from the colour profile {name[:60]!r} to sRGB")
    except (ImageCms.PyCMSError, OSError, ValueError) as error:
        said.append(f"its colour profile cannot be used ({first_line(error)[:60]})")
        turned = plain.convert("RGB")
    if turned is None:  # only where a picture is changed in place
        turned = plain.convert("RGB")
    if opacity is not None:
        turned.putalpha(opacity)
    return turned


def quiet_tifffile() -> ModuleType:
    """The package tifffile, which says what it thinks of a file to nobody."""

    logging.getLogger("tifffile").setLevel(logging.CRITICAL + 1)
    return tifffile


def check_tiff_page(page: TiffPage, path: Path, what: str) -> None:
    """Raises InputError for a page with more numbers than can be computed with, without any, or with more
    parts than its file has bytes, which would be looked for one by one."""
    check_numbers(page.shape, path, what)
    if not page.dataoffsets or 0 in (*page.shape, *page.chunks):
        raise InputError(f"{what}: {str(path)!r} is damaged: it has a page without a picture")
    parts, size = math.prod(page.chunked), path.stat().st_size
    if parts > size:
        raise InputError(f"{what}: {str(path)!r} is damaged: {parts} parts of a picture in {size} bytes")


def _tiff(path: Path, what: str, measured: bool) -> Decoded | None:
    """A TIFF of grey or RGB with its own type; None for one that Pillow reads better: palettes, CMYK, and
    ways to compress that need more than tifffile has."""
    tifffile = quiet_tifffile()
    with tifffile.TiffFile(path) as file:
        pages = list(islice((page for page in file.pages if not _is_thumbnail(page)), 2))
        page = (pages[0] if pages else file.pages[0]).aspage()
        check_tiff_page(page, path, what)
        if len(pages) > 1:
            raise InputError(f"{what}: {str(path)!r} holds several pages; save the one that you mean")
        profile = page.tags.get(34675)
        eight = page.dtype is not None and page.dtype.itemsize == 1
        if page.photometric not in PHOTOMETRIC_PLAIN or (profile is not None and eight and not measured):
            return None
        try:
            values = page.asarray()
        except (ValueError, KeyError, RuntimeError, ImportError):  # ways to compress that it does not have
            return None
        said = [] if profile is None or measured else ["its colour profile is not used"]
        if page.planarconfig == 2 and values.ndim == 3:
            values = np.moveaxis(values, 0, -1)
        extra = [int(kind) for kind in page.extrasamples or ()]
        if values.ndim == 3 and extra and not any(kind in EXTRA_ALPHA for kind in extra):
            said.append(f"{len(extra)} channels in addition to its colours are not used")
            values = values[..., : values.shape[-1] - len(extra)]
        if page.photometric == PHOTOMETRIC_WHITE_IS_ZERO and values.dtype.kind in "bu":
            values = ~values if values.dtype == bool else np.iinfo(values.dtype).max - values
        tag = page.tags.get(ORIENTATION)
        orientation = int(tag.value) if tag is not None else 1
        if orientation in TURNS:
            values = TURNS[orientation](values)
            said.append(f"turned upright (orientation {orientation})")
        nodata = page.tags.get(GDAL_NODATA)
        if measured and nodata is not None:
            values = _without(values, str(nodata.value), said)
    return Decoded(values, None, tuple(said))


def _is_thumbnail(page: object) -> bool:
    return bool(int(getattr(page, "subfiletype", 0) or 0) & 1)


def _without(values: np.ndarray, nodata: str, said: list[str]) -> np.ndarray:
    """Numbers with NaN where GDAL's tag says that there are none."""
    try:
        number = float(nodata.strip("\x00 "))
    except ValueError:
        return values
    missing = values == number
    if np.isnan(number) or not missing.any():
        return values
    said.append(f"{number:g} is a hole (GDAL_NODATA)")
    return np.where(missing, np.nan, values.astype(float))


def read_16_bits(path: Path) -> np.ndarray | None:
    """A PNG file of 16 bits, uint16 [y, x, channel]; None for other files, and for interlaced ones.

    Raises ValueError for a damaged file.
    """
    data = path.read_bytes()
    if data[:8] != PNG_BEGINS or len(data) < 33:
        return None
    columns, rows, bits, kind, _, _, interlaced = struct.unpack(">IIBBBBB", data[16:29])
    if bits != 16 or kind not in PNG_CHANNELS or interlaced:
        return None
    channels = PNG_CHANNELS[kind]
    row = 1 + 2 * channels * columns
    unpacked = zlib.decompressobj().decompress(_pixels(data), rows * row)
    if len(unpacked) < rows * row:
        raise ValueError("it is cut short")
    filtered = np.frombuffer(unpacked, np.uint8).reshape(rows, row)
    # a row's filter (PNG 3, clause 9) relates bytes of the same place in a pixel alone: each place is a grey
    # picture of 8 bits
    planes = [_grey(filtered[:, :1], filtered[:, 1 + k :: 2 * channels]) for k in range(2 * channels)]
    found = [planes[2 * k].astype(np.uint16) << 8 | planes[2 * k + 1] for k in range(channels)]
    return np.stack(found, axis=-1)


def _pixels(data: bytes) -> bytes:
    """What the IDAT chunks hold."""
    found: list[bytes] = []
    at = 8
    while at + 12 <= len(data):
        length = int.from_bytes(data[at : at + 4], "big")
        if data[at + 4 : at + 8] == b"IDAT":
            found.append(data[at + 8 : at + 8 + length])
        at += 12 + length
    return b"".join(found)


def _grey(filters: np.ndarray, plane: np.ndarray) -> np.ndarray:
    """Rows of filtered bytes [y, x], with their filters [y, 1], as bytes without them."""
    rows, columns = plane.shape
    head = struct.pack(">IIBBBBB", columns, rows, 8, 0, 0, 0, 0)
    body = zlib.compress(np.concatenate([filters, plane], axis=1).tobytes(), 0)
    chunks = [(b"IHDR", head), (b"IDAT", body), (b"IEND", b"")]
    file = PNG_BEGINS + b"".join(
        struct.pack(">I", len(content)) + name + content + struct.pack(">I", zlib.crc32(name + content))
        for name, content in chunks
    )
    with Image.open(io.BytesIO(file), formats=("PNG",)) as image:
        return np.asarray(image)
