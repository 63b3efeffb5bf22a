"""Images as files, and the transfer curve of sRGB.

Arrays are [y, x, channel] or [y, x], row 0 the top. Every reader raises InputError that names the file and
what it is for.
"""

from __future__ import annotations

import io
import math
import os
import warnings
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from ..errors import InputError, first_line
from .files import whole, write_bytes

if TYPE_CHECKING:
    import OpenEXR
    from numpy.typing import ArrayLike
    from torch import Tensor


A = TypeVar("A", np.ndarray, "Tensor")


MAX_PIXELS = 1 << 26
"""Of one picture, 8192 x 8192: as linear light in three channels these take 1.5 GiB."""
MAX_NUMBERS = 1 << 28
"""Of a depth map or spectral cube."""


def srgb_encode(linear: A) -> A:
    """Transfer curve of sRGB (IEC 61966-2-1): linear in, encoded out, both clipped to [0, 1], same shape."""
    x = linear.clip(0, 1)
    low = x <= 0.0031308
    return low * (12.92 * x) + ~low * (1.055 * x.clip(0.0031308) ** (1 / 2.4) - 0.055)  # pyrefly: ignore


def srgb_decode(encoded: A) -> A:
    """The inverse of `srgb_encode`: values in [0, 1] to linear ones, same shape. Values above 1 go on."""
    low = encoded <= 0.04045
    return low * (encoded / 12.92) + ~low * ((encoded.clip(0.04045) + 0.055) / 1.055) ** 2.4  # pyrefly: ignore


def existing(path: Path, what: str) -> Path:
    """The path of a file that is there. Raises InputError."""
    if not path.is_file():
        raise InputError(f"{what}: the file {str(path)!r} does not exist")
    return path


def check_pixels(rows: int, columns: int, path: Path, what: str) -> None:
    """Raises InputError for a picture too large to hold, by what its file says of itself."""
    if rows * columns > MAX_PIXELS:
        raise InputError(
            f"{what}: {str(path)!r} has {columns} x {rows} pixels, too many to read (at most "
            f"{MAX_PIXELS >> 20} x 2^20); scale it down or cut it"
        )


def check_numbers(shape: tuple[int, ...], path: Path, what: str) -> None:
    """Raises InputError for an array too large to compute with."""
    count = math.prod(shape)
    if count > MAX_NUMBERS:
        size = " x ".join(map(str, shape))
        raise InputError(
            f"{what}: {str(path)!r} holds {size} numbers ({count * 8 / 2**30:.1f} GiB in double precision), "
            f"more than {MAX_NUMBERS >> 20} x 2^20; cut it to the part that you need"
        )


def read_picture(path: Path, what: str) -> np.ndarray:
    """A PNG, JPEG or TIFF as it is stored, [y, x] or [y, x, channel]."""
    existing(path, what)
    from skimage.io import imread

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a size that is too large is said below
            with Image.open(path) as header:
                columns, rows = header.size
    except Exception:  # of a kind that another reader knows, or damaged: that one says so
        columns = rows = 0
    check_pixels(rows, columns, path, what)
    try:
        image = imread(path)
    except Exception as error:  # the readers behind imread raise nearly anything
        raise InputError(
            f"{what}: {str(path)!r} is not a picture that can be read (PNG, JPEG, TIFF): {first_line(error)}"
        ) from error
    if image.ndim not in (2, 3) or image.size == 0 or image.dtype.kind not in "buif":
        raise InputError(f"{what}: {str(path)!r} holds an array of shape {image.shape}, not one picture")
    if image.dtype.kind == "f" and not np.isfinite(image).all():
        raise InputError(f"{what}: {str(path)!r} holds values that are not finite")
    return image


def unit_rgb(image: np.ndarray) -> np.ndarray:
    """A picture of any kind as three channels in [0, 1], float64 [y, x, 3]; transparency is painted white.

    Raises InputError for another shape than [y, x] or [y, x, 1 to 4].
    """
    image = np.asarray(image)
    if image.dtype == bool:
        image = image.astype(float)
    elif np.issubdtype(image.dtype, np.integer):
        image = image / np.iinfo(image.dtype).max
    if image.ndim == 2:
        image = image[..., None]
    if image.ndim != 3:
        raise InputError(f"a picture needs the shape [y, x] or [y, x, channel], not {image.shape}")
    if image.shape[2] in (2, 4):  # alpha: paint on white
        alpha = image[..., -1:]
        image = image[..., :-1] * alpha + (1 - alpha)
    if image.shape[2] not in (1, 3):
        raise InputError(
            f"a picture needs the shape [y, x, 1 to 4 channels], not {list(image.shape)}; one from "
            "`read_image` is [channel, y, x] and linear: give the file instead"
        )
    return np.clip(np.broadcast_to(image, (*image.shape[:2], 3)), 0, 1)


def png_bytes(pixels: np.ndarray, texts: Mapping[str, str] | None = None) -> bytes:
    """uint8 [y, x, 3] or uint16 [y, x] as a PNG file with `texts` in it; the same gives the same bytes."""
    about = PngInfo()
    for key, text in (texts or {}).items():
        about.add_text(key, text)
    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, "PNG", pnginfo=about, compress_level=4)
    return buffer.getvalue()


def write_png(path: Path, image: ArrayLike) -> Path:
    """An image [3, y, x] of values as people see them, 1 is white, as PNG of 8 bits. Returns the path.

    Values beyond [0, 1] are clipped, and NaN is black. Raises what `files.whole` raises.
    """
    values = np.nan_to_num(np.asarray(image).transpose(1, 2, 0)).clip(0, 1)
    return write_bytes(path, png_bytes((values * 255).round().astype(np.uint8)))


@lru_cache(maxsize=1)
def openexr() -> ModuleType:
    """The package OpenEXR, with all cores to unpack what it reads and pack what it writes; by itself it takes
    one."""
    import OpenEXR

    OpenEXR.set_global_thread_count(os.cpu_count() or 1)
    return OpenEXR


def read_exr(path: Path, what: str) -> dict[str, np.ndarray]:
    """The channels of an OpenEXR file by name, each [y, x]."""
    existing(path, what)
    reader = openexr()
    try:
        with reader.File(str(path), header_only=True) as file:
            low, high = (np.asarray(corner, int) for corner in file.header()["dataWindow"])
            columns, rows = (high - low + 1).tolist()
            names = [channel.name for channel in file.header()["channels"]]
        check_pixels(rows, columns, path, what)
        check_numbers((len(names), rows, columns), path, what)
        with reader.File(str(path), separate_channels=True) as file:
            return {name: np.array(channel.pixels) for name, channel in file.channels().items()}
    except InputError:
        raise
    except Exception as error:  # OpenEXR raises its own kinds
        raise InputError(f"{what}: {str(path)!r} cannot be read as OpenEXR: {first_line(error)}") from error


def read_exr_rgb(path: Path, what: str) -> np.ndarray:
    """R, G and B of an OpenEXR file, or Y three times, float32 [y, x, 3]."""
    channels = read_exr(path, what)
    names = ("R", "G", "B") if "R" in channels else ("Y",) * 3
    if any(name not in channels for name in names):
        raise InputError(
            f"{what}: {str(path)!r} has no channels R, G, B; it has {', '.join(sorted(channels))}"
        )
    return np.stack([channels[name].astype(np.float32) for name in names], axis=-1)


def write_exr(path: Path, channels: Mapping[str, np.ndarray], attributes: Mapping[str, object]) -> Path:
    """Float32 planes [y, x] by name, with a header, as an OpenEXR file. Returns the path.

    Raises what `files.whole` raises.
    """
    writer = openexr()
    header = {"compression": writer.ZIP_COMPRESSION, "type": writer.scanlineimage, **attributes}
    planes = {name: np.ascontiguousarray(plane, np.float32) for name, plane in channels.items()}
    with whole(path) as temporary:
        save_exr(writer.File(header, planes), temporary)
    return path


def save_exr(file: OpenEXR.File, path: Path) -> None:
    """Write it there and then, and not as `files.whole` does. Raises OSError where that cannot be."""
    try:
        file.write(str(path))
    except RuntimeError as error:  # OpenEXR's own kind, for anything that goes wrong with the file
        raise OSError(first_line(error)) from error


def mirrored(index: A, size: int) -> A:
    """Integers, of NumPy or torch, as indices into an axis of `size` pixels that its mirror images continue;
    the border pixel is repeated: 0 1 2 2 1 0 0 1 for 0 to 7 and three pixels."""
    last = 2 * size - 1
    return (last - abs(2 * (index % (2 * size)) - last)) // 2  # pyrefly: ignore
