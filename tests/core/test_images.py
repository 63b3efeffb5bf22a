"""The curve of sRGB against its standard and colour-science; images through files."""

from __future__ import annotations

import io
import warnings
from pathlib import Path

import colour
import numpy as np
import pytest
import torch
from PIL import Image

from edofsim.core.images import (
    mirrored,
    png_bytes,
    read_exr,
    read_exr_rgb,
    read_picture,
    srgb_decode,
    srgb_encode,
    unit_rgb,
    write_exr,
    write_png,
)
from edofsim.errors import InputError


def test_srgb_curve_against_its_definition():
    """IEC 61966-2-1: 0.0031308 is where the line meets the power; 0.2140 encodes to 0.5."""
    linear = torch.tensor([-1.0, 0.0, 0.0031308, 0.21404114, 1.0, 3.0], dtype=torch.float64)
    encoded = torch.tensor([0.0, 0.0, 12.92 * 0.0031308, 0.5, 1.0, 1.0], dtype=torch.float64)
    assert torch.allclose(srgb_encode(linear), encoded, atol=1e-6)


@pytest.mark.parametrize("kind", [np.asarray, torch.from_numpy])
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_srgb_matches_colour_science_in_both_libraries(kind, dtype: type):
    values = np.linspace(0, 1, 1001, dtype=dtype)
    tolerance = 10 * np.finfo(dtype).eps
    for own, theirs in ((srgb_encode, colour.cctf_encoding), (srgb_decode, colour.cctf_decoding)):
        found = own(kind(values))
        assert type(found) is type(kind(values)) and np.asarray(found).dtype == dtype
        np.testing.assert_allclose(np.asarray(found), theirs(values, "sRGB"), atol=tolerance)


def test_srgb_has_a_finite_gradient_everywhere():
    linear = torch.tensor([-0.1, 0.0, 0.001, 0.5, 1.0, 2.0], requires_grad=True)
    srgb_encode(linear).sum().backward()
    assert torch.isfinite(linear.grad).all() and linear.grad[1] == pytest.approx(12.92)


def test_srgb_keeps_what_is_not_a_number():
    assert srgb_encode(torch.tensor([torch.nan])).isnan().all()
    assert np.isnan(srgb_decode(np.array([np.nan]))).all()


def test_exr_comes_back_bit_for_bit(tmp_path: Path):
    planes = dict(zip("RGB", np.random.default_rng(0).normal(size=(3, 5, 7)).astype(np.float32), strict=True))
    path = write_exr(tmp_path / "new" / "a.exr", planes, {"exposure": 2.5, "how": "by hand"})
    found = read_exr(path, "image")
    assert found.keys() == planes.keys()
    assert all(np.array_equal(found[name], plane) for name, plane in planes.items())
    np.testing.assert_array_equal(read_exr_rgb(path, "image")[..., 2], planes["B"])


def test_an_exr_without_colours_is_grey_or_refused(tmp_path: Path):
    plane = np.ones((2, 3), np.float32)
    write_exr(tmp_path / "grey.exr", {"Y": plane}, {})
    assert read_exr_rgb(tmp_path / "grey.exr", "image").shape == (2, 3, 3)
    write_exr(tmp_path / "depth.exr", {"Z": plane}, {})
    with pytest.raises(InputError, match="no channels R, G, B; it has Z"):
        read_exr_rgb(tmp_path / "depth.exr", "image")


def test_png_holds_values_upright_and_clipped(tmp_path: Path):
    image = torch.zeros(3, 2, 3)
    image[0, 0, 2] = 7.0  # red beyond white, top right
    image[1, 1, 0] = 0.5
    image[2, 1, 1] = torch.nan
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # which number an undefined conversion gives is the processor's choice
        path = write_png(tmp_path / "a.png", image)
    found = read_picture(path, "image")
    assert found.shape == (2, 3, 3) and found.dtype == np.uint8
    assert found[0, 2].tolist() == [255, 0, 0] and found[1, 0].tolist() == [0, 128, 0]
    assert not found[1, 1].any()


def test_png_of_sixteen_bits_with_a_text():
    levels = np.arange(6, dtype=np.uint16).reshape(2, 3) * 13107
    data = png_bytes(levels, {"edofsim": "a text"})
    assert data == png_bytes(levels, {"edofsim": "a text"})
    image = Image.open(io.BytesIO(data))
    assert image.text["edofsim"] == "a text" and np.array_equal(np.asarray(image), levels)


def test_files_that_are_no_images_are_named(tmp_path: Path):
    (tmp_path / "text").write_text("no image")
    for read in (read_picture, read_exr, read_exr_rgb):
        with pytest.raises(InputError, match="cover: the file '.*none' does not exist"):
            read(tmp_path / "none", "cover")
        with pytest.raises(InputError, match="cover: '.*text'"):
            read(tmp_path / "text", "cover")


@pytest.mark.parametrize(
    ("image", "value"),
    [
        (np.full((2, 3), 51, np.uint8), 0.2),
        (np.full((2, 3, 1), 13107, np.uint16), 0.2),
        (np.array([[[0.2, 0.2, 0.2, 1.0]]]), 0.2),
        (np.array([[[0.2, 0.25]]]), 0.8),  # a quarter of 0.2, the rest white
        (np.array([[True]]), 1.0),
    ],
)
def test_pictures_of_every_kind_have_three_channels(image: np.ndarray, value: float):
    found = unit_rgb(image)
    assert found.shape == (*image.shape[:2], 3)
    np.testing.assert_allclose(found, value)


@pytest.mark.parametrize("kind", [np.arange, torch.arange])
def test_mirrored_indices_go_to_and_fro(kind):
    assert mirrored(kind(-4, 8), 3).tolist() == [2, 2, 1, 0, 0, 1, 2, 2, 1, 0, 0, 1]
    assert mirrored(kind(-3, 7), 4).tolist() == [2, 1, 0, 0, 1, 2, 3, 3, 2, 1]
    assert mirrored(kind(3), 1).tolist() == [0, 0, 0]
