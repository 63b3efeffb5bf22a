"""PSNR and SSIM against their definitions and scikit-image."""

from __future__ import annotations

import math

import pytest
import torch
from skimage import data
from skimage.metrics import peak_signal_noise_ratio

from edofsim.errors import InputError
from edofsim.restore.scores import image_psnr, light_error, psnr, score, score_by_depth


def pair() -> tuple[torch.Tensor, torch.Tensor]:
    truth = torch.from_numpy(data.coffee()[:60, :80] / 255.0).permute(2, 0, 1)
    return truth + 0.05 * torch.randn(truth.shape, generator=torch.Generator().manual_seed(0)), truth


def test_psnr_is_scikit_images():
    image, truth = pair()
    expected = peak_signal_noise_ratio(truth.numpy(), image.numpy(), data_range=1.0)
    assert psnr(image, truth) == pytest.approx(expected, abs=1e-9)


def test_a_constant_offset_has_its_closed_form():
    """An error of 0.1 everywhere is 20 dB."""
    assert psnr(torch.full((3, 4, 4), 0.6), torch.full((3, 4, 4), 0.5)) == pytest.approx(20.0, abs=1e-5)


def test_equal_images_score_infinity_and_one():
    _, truth = pair()
    equal = score(truth, truth)
    assert equal.psnr_db == math.inf and equal.ssim == pytest.approx(1.0)


def test_depth_ranges_share_out_all_pixels_and_infinity_belongs_to_the_last():
    image, truth = pair()
    inverse_depth = torch.zeros(60, 80)
    inverse_depth[:, :40] = 2.0
    inverse_depth[:, 40:60] = 1.0
    whole, scores = score_by_depth(image, truth, "none", inverse_depth)
    assert whole == score(image, truth)
    assert [(s.near_m, s.far_m, s.score.pixels) for s in scores] == [
        (0.0, 0.6, 2400),
        (0.85, 1.15, 1200),
        (3.0, math.inf, 1200),
    ]
    total = sum(s.score.pixels * 10 ** (-s.score.psnr_db / 10) for s in scores) / (60 * 80)
    assert -10 * math.log10(total) == pytest.approx(image_psnr(image, truth), abs=1e-9)


def test_what_a_sensor_cannot_hold_counts_in_no_score():
    """A highlight ten times full scale is as good as full scale, in every score."""
    image, truth = pair()
    bright, cut = truth.clone(), truth.clone()
    bright[:, 20:30, 20:30], cut[:, 20:30, 20:30] = 10.0, 1.0
    assert image_psnr(image.clamp(0, 1), cut) == image_psnr(image, bright) != psnr(image, bright)
    assert score(image, bright) == score(image.clamp(0, 1), cut)


def test_light_is_off_by_the_worst_channel():
    _, truth = pair()
    off = torch.tensor([1.01, 0.93, 1.05], dtype=torch.float64)[:, None, None]
    assert light_error(truth * off, truth) == pytest.approx(0.07)
    assert light_error(truth.flip(-1), truth) == pytest.approx(0, abs=1e-12)  # the same light elsewhere
    left = torch.zeros(60, 80, dtype=torch.bool)
    left[:, :40] = True
    halves = torch.where(left, truth, truth * off)
    assert light_error(halves, truth, left) == 0
    assert light_error(halves, truth, ~left) == pytest.approx(0.07)


def test_no_part_of_black_is_off():
    assert math.isnan(
        light_error(torch.ones(3, 4, 4), torch.tensor([1.0, 0, 1])[:, None, None].expand(3, 4, 4))
    )


def test_an_image_smaller_than_the_ssim_window_has_no_ssim():
    assert math.isnan(score(torch.zeros(3, 5, 40), torch.ones(3, 5, 40)).ssim)


def test_different_shapes_are_refused():
    with pytest.raises(InputError, match="cannot be compared"):
        psnr(torch.zeros(3, 4, 4), torch.zeros(3, 4, 5))
