"""Picture files of high dynamic range: OpenEXR, Radiance and PFM.

Arrays are [y, x, channel] or [y, x], row 0 the top. Every reader raises InputError that names the file and
what it is for.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from ..errors import InputError
from .images import read_exr_rgb
from .limits import check_pixels, existing


def read_hdr(path: Path, what: str) -> np.ndarray:
    """Linear RGB from an .exr or .hdr file, float32 [y, x, 3], finite.
    Raises InputError for a file that is damaged, of no known kind, or not finite."""
    existing(path, what)
    readers = {".exr": read_exr_rgb, ".hdr": read_radiance, ".pic": read_radiance, ".pfm": read_pfm}
    reader = readers.get(path.suffix.lower())
    if reader is None:
        raise InputError(f"{what}: {str(path)!r} is not of a known kind; known: {', '.join(readers)}")
    image = reader(path, what)
    if image.ndim == 2:
        image = np.repeat(image[..., None], 3, axis=2)
    if not np.isfinite(image).all():
        raise InputError(f"{what}: {str(path)!r} holds values that are not finite")
    return image


def read_pfm(path: Path, what: str) -> np.ndarray:
    """A Portable Float Map, float32 [y, x] or [y, x, 3]; the file counts rows from below.
    Raises InputError for a file that is cut short or no PFM."""
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
    """A Radiance picture (.hdr, RGBE, plain or run-length encoded), float32 [y, x, 3].
    Raises InputError for a file that is damaged or no Radiance picture."""
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
