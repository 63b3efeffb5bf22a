"""PNG colours of 16 bits are read whole, whatever filters their rows have."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import numpy as np
import pytest

from edofsim.core.colours import read_colours
from edofsim.core.decoded import decoded
from edofsim.core.images import srgb_decode
from edofsim.errors import InputError

KINDS = {2: 4, 3: 2, 4: 6}
"""Colour types by channels."""


def predicted(left: int, up: int, corner: int, kind: int) -> int:
    """What a filter subtracts (PNG 3, clause 9.2)."""
    if kind == 4:
        away = [(abs(left + up - corner - one), order, one) for order, one in enumerate((left, up, corner))]
        return min(away)[2]
    return (0, left, up, (left + up) // 2)[kind]


def png(image: np.ndarray, filters: np.ndarray) -> bytes:
    """uint16 [y, x, channel] as a file whose rows have those filters, written by the specification."""
    rows, columns, channels = image.shape
    step = 2 * channels
    body = b""
    above = [0] * (step * columns)
    for row, kind in zip(image.astype(">u2").reshape(rows, -1), filters.tolist(), strict=True):
        here = list(row.tobytes())
        line = bytearray([kind])
        for k, byte in enumerate(here):
            left, corner = (here[k - step], above[k - step]) if k >= step else (0, 0)
            line.append((byte - predicted(left, above[k], corner, kind)) % 256)
        body += bytes(line)
        above = here

    def chunk(name: bytes, content: bytes) -> bytes:
        sealed = name + content
        return struct.pack(">I", len(content)) + sealed + struct.pack(">I", zlib.crc32(sealed))

    packed = zlib.compress(body)
    cut = len(packed) // 2
    head = struct.pack(">IIBBBBB", columns, rows, 16, KINDS[channels], 0, 0, 0)
    chunks = chunk(b"IHDR", head) + chunk(b"IDAT", packed[:cut]) + chunk(b"IDAT", packed[cut:])
    return b"\x89PNG\r\n\x1a\n" + chunks + chunk(b"IEND", b"")


@pytest.mark.parametrize("seed", range(50))
def test_colours_of_16_bits_are_read_whole(tmp_path: Path, seed: int):
    draw = np.random.default_rng(seed)
    shape = (*draw.integers(1, 9, 2).tolist(), int(draw.integers(2, 5)))
    image = draw.integers(0, 65536, shape, np.uint16) // (1 << draw.integers(0, 12))
    (tmp_path / "a.png").write_bytes(png(image, draw.integers(0, 5, shape[0])))
    found = decoded(tmp_path / "a.png", "picture")
    np.testing.assert_array_equal(found.values, image)
    assert not found.said


def test_a_picture_of_16_bits_has_more_than_256_tones(tmp_path: Path):
    ramp = np.arange(4096, dtype=np.uint16).reshape(64, 64, 1).repeat(3, axis=2) * 16
    (tmp_path / "a.png").write_bytes(png(ramp, np.full(64, 1)))
    found = read_colours(tmp_path / "a.png", "picture").linear
    np.testing.assert_allclose(found, srgb_decode(ramp / 65535), rtol=1e-12)


def test_a_file_that_is_cut_short_is_refused(tmp_path: Path):
    (tmp_path / "a.png").write_bytes(png(np.zeros((64, 64, 3), np.uint16), np.zeros(64, int))[:-60])
    with pytest.raises(InputError, match="not a picture that can be read"):
        decoded(tmp_path / "a.png", "picture")


def test_what_is_read_with_8_bits_says_so(tmp_path: Path):
    (tmp_path / "a.ppm").write_bytes(b"P6\n4 3\n65535\n" + bytes(72))
    assert decoded(tmp_path / "a.ppm", "picture").said == ("8 of its 16 bits",)
