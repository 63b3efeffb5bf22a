"""Pictures: the sRGB curve, one exposure for all, and nothing hidden."""

from __future__ import annotations

import io
import math

import numpy as np
import pytest
import torch
from PIL import Image

from edofsim.report.pictures import Box, clipped_fraction, display_gain, picture, with_boxes


def decoded(shown) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(shown.png)))


def test_png_holds_the_encoded_values_upright():
    image = torch.zeros(3, 2, 3)
    image[0, 0, 2] = 1.0  # red, top right
    image[1, 1, 0] = 0.21404114  # half green, bottom left
    pixels = decoded(picture(image, "a", "b"))
    assert pixels.shape == (2, 3, 3)
    assert pixels[0, 2].tolist() == [255, 0, 0]
    assert pixels[1, 0].tolist() == [0, 128, 0]


def test_same_image_same_bytes():
    image = torch.rand(3, 9, 9, generator=torch.Generator().manual_seed(3))
    assert picture(image, "a", "b").png == picture(image, "a", "b").png


def test_not_a_number_turns_magenta():
    image = torch.full((3, 2, 2), 0.5)
    image[1, 0, 1] = math.nan
    image[0, 1, 0] = math.inf
    pixels = decoded(picture(image, "a", "b"))
    assert pixels[0, 1].tolist() == pixels[1, 0].tolist() == [255, 0, 255]
    assert pixels[0, 0].tolist() == [188, 188, 188]  # sRGB of one half


def test_dark_images_are_brightened_bright_ones_never():
    assert display_gain(torch.full((3, 4, 4), 0.09)) == pytest.approx(10)
    assert display_gain(torch.full((3, 4, 4), 0.6)) == 1.0
    assert display_gain(torch.zeros(3, 4, 4)) == 1.0
    assert display_gain(torch.full((3, 4, 4), math.nan)) == 1.0


def test_clipping_is_told():
    image = torch.zeros(3, 10, 10)
    image[:, 0] = 0.6
    assert clipped_fraction(image) == 0.0
    assert clipped_fraction(image, gain=2.0) == pytest.approx(0.1)


def test_large_images_are_averaged_in_linear_light_and_say_so():
    image = torch.zeros(3, 4, 2000)
    image[:, :, ::2] = 1.0
    shown = picture(image, "a", "b")
    assert (shown.width, shown.height) == (1000, 2)
    assert "1/2" in shown.note
    assert np.all(decoded(shown) == 188)  # sRGB of the mean one half
    box = with_boxes(shown, (Box(100, 2, 40, 2, "A"),), 2000).boxes[0]
    assert (box.x, box.y, box.width, box.height, box.name) == (50, 1, 20, 1, "A")
