"""Scores without the noise of the rendering: truth, noise and restoration are known in closed form."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.ndimage import gaussian_filter
from skimage.metrics import structural_similarity

from edofsim.capture.noise import PhotoNoise
from edofsim.restore.scores import Noise, Score, score, score_parts
from edofsim.restore.truth import Truth, noise_figures, samples_for

SIDE = 96
SHARE = 0.6
"""Part of the truth's noise that the restored image shares: it is blurred by 0.8 pixels and scaled so."""


def seen(rng, alike):
    """Noise of three channels that are alike, of neighbours too where `alike` pixels are above 0."""
    one = rng.normal(size=(1, SIDE, SIDE)) + 0.3 * rng.normal(size=(3, SIDE, SIDE))
    one = gaussian_filter(one, (0, alike, alike), mode="wrap") if alike else one
    # more noise on the left than on the right
    return torch.from_numpy(one / one.std() * np.linspace(1.5, 0.5, SIDE))


def shared(noise):
    return SHARE * torch.from_numpy(gaussian_filter(noise.numpy(), (0, 0.8, 0.8), mode="wrap"))


def scene():
    """A truth, and what a restoration makes of it without noise, within the scale."""
    y, x = np.mgrid[:SIDE, :SIDE] / SIDE
    truth = np.stack([0.5 + 0.25 * np.sin(7 * x + k) * np.cos(5 * y) for k in range(3)])
    return torch.from_numpy(truth), torch.from_numpy(
        gaussian_filter(truth, (0, 5, 5)) + 0.02 * np.cos(20 * y)
    )


def drawn(seed, level, alike):
    """An image, its truth and their noise, all as renderings of one scene give them."""
    rng = np.random.default_rng(seed)
    truth, restored = scene()
    noise, half = (level * seen(rng, alike) for _ in range(2))
    return restored + shared(noise), truth + noise, Noise(half, shared(half))


@pytest.mark.parametrize("alike", [0.0, 1.5])
@pytest.mark.parametrize("level", [0.01, 0.03])
def test_scores_are_those_of_images_without_noise(level, alike):
    """Over many draws: PSNR has no bias; SSIM, which is a ratio of moments, little of what noise costs it.
    The standard errors are as the draws scatter. The score with noise is far off."""
    truth, restored = scene()
    exact = score(restored, truth)
    draws = [drawn(seed, level, alike) for seed in range(40)]
    found, noisy = [score(*each) for each in draws], [score(*each[:2]) for each in draws[:5]]
    for name in ("psnr_db", "ssim"):
        off = np.array([getattr(each, name) for each in found]) - getattr(exact, name)
        told = np.mean([getattr(each, name + "_se") for each in found])
        lost = getattr(exact, name) - np.mean([getattr(each, name) for each in noisy])
        assert lost > 0 and 0.7 < told / off.std() < 1.4, name
        most = 0.25 * told if name == "psnr_db" else (0.5 if alike else 0.03) * lost
        assert abs(off.mean()) < 4 * off.std() / math.sqrt(len(off)) + most, name
    lost = exact.psnr_db - np.mean([each.psnr_db for each in noisy])
    assert lost > 6 * np.std([each.psnr_db for each in found]) or alike


@pytest.mark.parametrize(
    "wrong",
    [
        lambda noise, truth: Noise(torch.zeros_like(noise.truth), torch.zeros_like(noise.image)),  # copies
        lambda noise, truth: Noise(noise.truth, torch.zeros_like(noise.image)),  # nothing is shared
        lambda noise, truth: Noise(noise.truth, -noise.image),  # the sign
        lambda noise, truth: Noise(noise.truth, noise.truth),  # the photo's half for the image's
        lambda noise, truth: Noise(2 * noise.truth, 2 * noise.image),  # the difference, not half of it
    ],
)
def test_wrong_halves_give_wrong_scores(wrong):
    truth, restored = scene()
    exact = score(restored, truth)
    image, noisy, noise = drawn(0, 0.03, 0.0)
    right, other = score(image, noisy, noise), score(image, noisy, wrong(noise, truth))
    assert abs(right.psnr_db - exact.psnr_db) < 3 * right.psnr_db_se
    assert not abs(other.psnr_db - exact.psnr_db) < 6 * right.psnr_db_se  # nan is wrong as well


def test_parts_have_standard_errors_of_their_own():
    image, noisy, noise = drawn(3, 0.02, 0.0)
    left = torch.zeros(SIDE, SIDE, dtype=torch.bool)
    left[:, : SIDE // 2] = True
    whole, noise_ratio, calmer = score_parts(image, noisy, [None, left, ~left], noise)
    assert noise_ratio.psnr_db_se > 1.3 * calmer.psnr_db_se > 0 and whole.pixels == 2 * noise_ratio.pixels


def test_what_noise_hides_is_not_told():
    """The restored image is exact, so that only noise is left to score: no number, and it says so."""
    truth, _ = scene()
    noise, half = (0.05 * seen(np.random.default_rng(seed), 0.0) for seed in (1, 2))
    found = score(truth, truth + noise, Noise(half, torch.zeros_like(half)))
    assert math.isnan(found.psnr_db) and found.psnr_db_se > 1


def test_ssim_is_scikit_images_where_there_is_no_noise():
    truth, restored = scene()
    how = {"gaussian_weights": True, "sigma": 1.5, "use_sample_covariance": False}
    theirs = structural_similarity(
        restored.numpy(), truth.numpy(), channel_axis=0, data_range=1, full=True, **how
    )
    assert score(restored, truth).ssim == pytest.approx(float(theirs[1].mean()), abs=1e-9)


def test_restoring_once_more_tells_what_is_shared():
    """A linear restoration: what it makes of the photo's noise, exactly. And at full scale no noise of the
    truth counts."""
    rng = np.random.default_rng(5)
    photo, blurred, ideal = (torch.from_numpy(rng.uniform(0.2, 0.6, (3, 20, 20))) for _ in range(3))
    half = 0.01 * torch.from_numpy(rng.normal(size=(3, 20, 20)))
    bright = ideal.clone()
    bright[:, :5] = 1.5
    truth = Truth(bright, PhotoNoise("taken out", half, blurred * 0.01))

    def restores(image):
        return 2 * image - 0.1

    left = truth.restored_noise(photo, restores(photo), restores)
    assert left is not None and torch.allclose(left, 0.02 * blurred, atol=1e-12)
    image, compared, noise = truth.compared(restores(photo), left)
    assert isinstance(noise, Noise) and noise.image is left
    top, rest = torch.zeros(20, 20, dtype=torch.bool), torch.ones(20, 20, dtype=torch.bool)
    top[:5], rest[:5] = True, False
    black = Noise(half, torch.zeros_like(half))  # nothing is shared: at full scale no noise is left at all
    clipped, open_ = score_parts(image, compared, [top, rest], black)
    assert clipped.psnr_db_se == 0 < open_.psnr_db_se


def test_without_known_noise_scores_say_what_they_hold():
    truth, restored = scene()
    exact = Truth(truth).compared(restored, None)
    unknown = Truth(truth, PhotoNoise("included")).compared(restored, None)
    one, other = score(*exact), score(*unknown)
    assert one.psnr_db == other.psnr_db and one.psnr_db_se == 0 and math.isnan(other.psnr_db_se)


def test_noise_below_full_scale_has_its_closed_form():
    """A hundredth of full scale is 40 dB."""
    one = torch.full((3, 4, 4), 0.01)
    assert noise_figures(PhotoNoise("taken out", one, -one / 10)) == pytest.approx(
        {"noise_db.truth": 40.0, "noise_db.photo": 60.0}, abs=1e-4
    )
    assert noise_figures(PhotoNoise("none")) == {}


def test_samples_that_a_score_takes():
    known = Score(30.0, 0.9, 100, 0.1)
    assert samples_for(known, 16) == 64
    assert samples_for(replace(known, psnr_db_se=0.001), 16) == 16
    assert samples_for(replace(known, psnr_db_se=math.nan), 16) is None
