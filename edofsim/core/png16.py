"""Colours of 16 bits from PNG files, of which Pillow keeps 8."""

from __future__ import annotations

import io
import struct
import zlib
from pathlib import Path

import numpy as np
from PIL import Image

SIGNATURE = b"\x89PNG\r\n\x1a\n"
CHANNELS = {2: 3, 4: 2, 6: 4}
"""Of the colour types that Pillow shortens: RGB, grey with opacity, RGB with opacity."""


def read_16_bits(path: Path) -> np.ndarray | None:
    """A PNG file of 16 bits, uint16 [y, x, channel]; None for other files, and for interlaced ones.

    Raises ValueError for a damaged file.
    """
    data = path.read_bytes()
    if data[:8] != SIGNATURE or len(data) < 33:
        return None
    columns, rows, bits, kind, _, _, interlaced = struct.unpack(">IIBBBBB", data[16:29])
    if bits != 16 or kind not in CHANNELS or interlaced:
        return None
    channels = CHANNELS[kind]
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
    file = SIGNATURE + b"".join(
        struct.pack(">I", len(content)) + name + content + struct.pack(">I", zlib.crc32(name + content))
        for name, content in chunks
    )
    with Image.open(io.BytesIO(file), formats=("PNG",)) as image:
        return np.asarray(image)
