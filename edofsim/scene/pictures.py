"""Picture files of the user's: 8 and 16 bit pictures, and high dynamic range in OpenEXR, Radiance and PFM.

Arrays are [y, x, channel] or [y, x], row 0 the top. Every reader raises InputError that names the file and
what it is for.
"""

from __future__ import annotations

import math
import re
import warnings
from pathlib import Path

import numpy as np

from ..errors import InputError

MAX_PIXELS = 1 << 26
"""Of one picture, 8192 x 8192: as linear light in three channels these take 1.5 GiB."""
MAX_NUMBERS = 1 << 28
"""Of a depth map or spectral cube."""


def first_line(error: Exception) -> str:
    """The beginning of another library's error, short enough for one sentence."""
    return (str(error).strip() or type(error).__name__).splitlines()[0][:160]


def existing(path: Path, what: str) -> Path:
    """The path of a file that is there. Raises InputError."""
    if not path.is_file():
        raise InputError(f"{what}: the file {str(path)!r} does not exist")
    return path


def read_picture(path: Path, what: str) -> np.ndarray:
    """A PNG, JPEG or TIFF as it is stored, [y, x] or [y, x, channel]."""
    existing(path, what)
    from PIL import Image
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


def read_hdr(path: Path, what: str) -> np.ndarray:
    """Linear RGB from an .exr or .hdr file, float32 [y, x, 3], finite."""
    existing(path, what)
    readers = {".exr": _exr_rgb, ".hdr": read_radiance, ".pic": read_radiance, ".pfm": read_pfm}
    reader = readers.get(path.suffix.lower())
    if reader is None:
        raise InputError(f"{what}: {str(path)!r} is not of a known kind; known: {', '.join(readers)}")
    image = reader(path, what)
    if image.ndim == 2:
        image = np.repeat(image[..., None], 3, axis=2)
    if not np.isfinite(image).all():
        raise InputError(f"{what}: {str(path)!r} holds values that are not finite")
    return image


def read_exr(path: Path, what: str) -> dict[str, np.ndarray]:
    """The channels of an OpenEXR file by name, each [y, x]."""
    existing(path, what)
    import OpenEXR

    try:
        with OpenEXR.File(str(path), header_only=True) as file:
            low, high = (np.asarray(corner, int) for corner in file.header()["dataWindow"])
            columns, rows = (high - low + 1).tolist()
            names = [channel.name for channel in file.header()["channels"]]
        check_pixels(rows, columns, path, what)
        check_numbers((len(names), rows, columns), path, what)
        with OpenEXR.File(str(path), separate_channels=True) as file:
            return {name: np.array(channel.pixels) for name, channel in file.channels().items()}
    except InputError:
        raise
    except Exception as error:  # OpenEXR raises its own kinds
        raise InputError(f"{what}: {str(path)!r} cannot be read as OpenEXR: {first_line(error)}") from error


def _exr_rgb(path: Path, what: str) -> np.ndarray:
    channels = read_exr(path, what)
    names = ("R", "G", "B") if "R" in channels else ("Y",) * 3
    if any(name not in channels for name in names):
        raise InputError(
            f"{what}: {str(path)!r} has no channels R, G, B; it has {', '.join(sorted(channels))}"
        )
    return np.stack([channels[name].astype(np.float32) for name in names], axis=-1)


def read_pfm(path: Path, what: str) -> np.ndarray:
    """A Portable Float Map, float32 [y, x] or [y, x, 3]; the file counts rows from below."""
    data = existing(path, what).read_bytes()
    header = re.match(rb"(P[Ff])\s+(\d+)\s+(\d+)\s+([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s", data)
    if header is None:
        raise InputError(f"{what}: {str(path)!r} does not begin as a PFM file does (Pf or PF, size, scale)")
    columns, rows = int(header[2]), int(header[3])
    channels = 3 if header[1] == b"PF" else 1
    check_pixels(rows, columns, path, what)
    kind = "<f4" if float(header[4]) < 0 else ">f4"
    body = data[header.end() :]
    if len(body) < 4 * columns * rows * channels:
        raise InputError(f"{what}: {str(path)!r} is cut short")
    image = np.frombuffer(body, kind, columns * rows * channels).reshape(rows, columns, channels)[::-1]
    return np.ascontiguousarray(image[..., 0] if channels == 1 else image, np.float32)


def read_radiance(path: Path, what: str) -> np.ndarray:
    """A Radiance picture (.hdr, RGBE, plain or run-length encoded), float32 [y, x, 3]."""
    data = existing(path, what).read_bytes()
    header = re.match(rb"#\?.*?\n\s*\n([-+])Y (\d+) ([-+])X (\d+)\n", data, re.DOTALL)
    if header is None or header[1] != b"-" or header[3] != b"+":
        raise InputError(f"{what}: {str(path)!r} is no Radiance picture with rows from the top and left")
    rows, columns = int(header[2]), int(header[4])
    check_pixels(rows, columns, path, what)
    try:
        pixels = _rgbe_rows(np.frombuffer(data, np.uint8, offset=header.end()), rows, columns)
    except (IndexError, ValueError):
        raise InputError(f"{what}: {str(path)!r} is cut short or damaged") from None
    exponent = pixels[..., 3:].astype(np.int32)
    scale = np.where(exponent > 0, np.ldexp(1.0, exponent - 136), 0.0)
    return (pixels[..., :3] * scale).astype(np.float32)


def _rgbe_rows(body: np.ndarray, rows: int, columns: int) -> np.ndarray:
    """Bytes of mantissas and exponent, uint8 [y, x, 4] (G. Ward, Graphics Gems II, "Real pixels")."""
    if not (8 <= columns < 32768 and body[0] == 2 and body[1] == 2 and body[2] < 128):
        return body[: rows * columns * 4].reshape(rows, columns, 4)
    pixels = np.empty((rows, 4, columns), np.uint8)
    at = 0
    for row in range(rows):
        if tuple(body[at : at + 2]) != (2, 2) or int(body[at + 2]) << 8 | int(body[at + 3]) != columns:
            raise ValueError("a row does not begin as it should")
        at += 4
        for channel in range(4):
            x = 0
            while x < columns:
                count = int(body[at])
                if count > 128:
                    count -= 128
                    run: np.ndarray | np.uint8 = body[at + 1]
                    at += 2
                else:
                    run = body[at + 1 : at + 1 + count]
                    at += 1 + count
                if count == 0 or x + count > columns:
                    raise ValueError("a run is too long")
                pixels[row, channel, x : x + count] = run
                x += count
    return pixels.transpose(0, 2, 1)
