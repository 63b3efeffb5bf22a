"""High dynamic range files, and environment maps made of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenEXR
import pytest

from edofsim.errors import InputError
from edofsim.recipe.lights import EnvironmentMap
from edofsim.scene import pictures
from edofsim.scene.lights import environment_map

BANDS = np.linspace(420e-9, 720e-9, 31)


def write_pfm(path: Path, image: np.ndarray, order: str = "<") -> None:
    kind = "PF" if image.ndim == 3 else "Pf"
    scale = -1.0 if order == "<" else 1.0
    header = f"{kind}\n{image.shape[1]} {image.shape[0]}\n{scale}\n".encode()
    path.write_bytes(header + np.ascontiguousarray(image[::-1]).astype(f"{order}f4").tobytes())


def write_rgbe(path: Path, image: np.ndarray, encode: bool) -> None:
    """Radiance's format, written as its definition says (Ward): shared exponent of the largest channel."""
    mantissa, exponent = np.frexp(image.max(axis=2))
    scale = np.where(image.max(axis=2) > 0, mantissa * 256 / np.maximum(image.max(axis=2), 1e-30), 0)
    rgbe = np.concatenate([image * scale[..., None], (exponent + 128)[..., None]], axis=2).astype(np.uint8)
    body = b""
    for row in rgbe:
        if not encode:
            body += row.tobytes()
            continue
        body += bytes([2, 2, len(row) >> 8, len(row) & 255])
        for channel in row.T:
            body += (
                bytes([128 + 3]) + bytes([channel[0]])
                if (channel[:3] == channel[0]).all()
                else bytes([3]) + channel[:3].tobytes()
            )
            rest = channel[3:]
            body += bytes([len(rest)]) + rest.tobytes()
    path.write_bytes(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y %d +X %d\n" % image.shape[:2] + body)


@pytest.mark.parametrize("order", ["<", ">"])
def test_pfm_counts_its_rows_from_below(tmp_path: Path, order: str):
    image = np.arange(12, dtype=np.float32).reshape(3, 4)
    write_pfm(tmp_path / "a.pfm", image, order)
    np.testing.assert_array_equal(pictures.read_pfm(tmp_path / "a.pfm", "x"), image)


@pytest.mark.parametrize("encode", [True, False])
def test_radiance_pictures_plain_and_encoded(tmp_path: Path, encode: bool):
    """8 bits of mantissa: within 1/128 of the largest channel."""
    image = np.random.default_rng(0).uniform(0.01, 50, (5, 20, 3)).astype(np.float32)
    image[:, :3] = image[:, :1]
    write_rgbe(tmp_path / "a.hdr", image, encode)
    got = pictures.read_hdr(tmp_path / "a.hdr", "x")
    assert (np.abs(got - image) <= image.max(axis=2, keepdims=True) / 128 + 1e-6).all()


DAMAGED = {
    "a.pfm": b"Pf\n4 4\n-1\n123",
    "a.hdr": b"#?RADIANCE\n\n-Y 9 +X 9\n12",
    "a.exr": b"not an exr",
    "a.jpg": b"x",
}


@pytest.mark.parametrize(("name", "content"), DAMAGED.items())
def test_damaged_files_are_named(tmp_path: Path, name: str, content: bytes):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=name.replace(".", r"\.")):
        pictures.read_hdr(tmp_path / name, "light")


def save_exr(path: Path, image: np.ndarray) -> None:
    channels = {c: np.ascontiguousarray(image[..., i]).astype(np.float32) for i, c in enumerate("RGB")}
    OpenEXR.File({"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}, channels).write(
        str(path)
    )


def test_white_in_an_environment_map_is_the_illuminant(tmp_path: Path):
    from edofsim.scene.spectra import illuminant

    save_exr(tmp_path / "sky.exr", np.full((8, 16, 3), 2.0))
    light = EnvironmentMap(kind="environment_map", path="sky.exr", scale=0.5, illuminant="A")
    radiance = environment_map(light, BANDS, tmp_path).radiance
    np.testing.assert_allclose((radiance.image @ radiance.basis)[3, 5], illuminant("A", BANDS), rtol=1e-5)


def test_an_environment_map_turns_to_the_right(tmp_path: Path):
    """Columns count from the left of straight ahead: a quarter turn moves a spot from the middle by 1/4."""
    image = np.zeros((8, 16, 3))
    image[4, 8] = 1
    save_exr(tmp_path / "sky.exr", image)
    light = EnvironmentMap(kind="environment_map", path="sky.exr", turn_deg=90)
    assert np.argwhere(environment_map(light, BANDS, tmp_path).radiance.image[..., 0] > 0).tolist() == [
        [4, 12]
    ]


def test_a_picture_of_another_shape_is_no_environment_map(tmp_path: Path):
    save_exr(tmp_path / "sky.exr", np.ones((8, 8, 3)))
    with pytest.raises(InputError, match="twice as wide"):
        environment_map(EnvironmentMap(kind="environment_map", path="sky.exr"), BANDS, tmp_path)
