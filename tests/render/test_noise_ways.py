"""Gains of ways against noise: formulas against closed forms, and errors against images that are known."""

from __future__ import annotations

import math

import numpy as np
import pytest

from docs.studies.noise_ways import (
    adaptive_bound,
    adaptive_gain,
    control_gain,
    edges_of,
    errors,
    psnr,
    samples_for,
)


def test_samples_shared_out_by_the_deviation_gain_most():
    """Variances 1 and 9: the error is 5 / n with n samples each, 4 / n with n / 2 and 3 n / 2."""
    variance = np.array([1.0, 9.0])
    assert adaptive_bound(variance) == pytest.approx(5 / 4)
    assert adaptive_gain(variance, np.sqrt(variance)) == pytest.approx(5 / 4)
    assert adaptive_gain(variance, np.ones(2)) == pytest.approx(1)
    assert adaptive_gain(variance, variance) < 5 / 4


def test_direct_light_apart_gains_what_it_takes_out():
    """No noise in direct light and a quarter in the rest: a quarter of the samples. As much noise in each
    half, independent, each at the whole cost: half as good as without."""
    assert control_gain(0, 1 / 4, 1) == pytest.approx(4)
    assert control_gain(1 / 2, 1 / 2, 1) == pytest.approx(1 / 2)
    assert control_gain(1 / 2, 1 / 2, 0) == pytest.approx(2)


@pytest.mark.parametrize("samples", [4, 16, 40, 64, 1000])
def test_samples_for_an_error_follow_the_curve_and_its_ends(samples: int):
    assert samples_for(1 / samples, {16: 1 / 16, 64: 1 / 64, 256: 1 / 256}) == pytest.approx(samples)


def test_noise_of_the_truth_is_subtracted():
    """Images of variance 4 against a truth that is the mean of two halves of variance 0.5 each: 4 is left."""
    draw = np.random.default_rng(3)
    halves = 0.5**0.5 * draw.standard_normal((2, 3, 200, 200))
    images = 2 * draw.standard_normal((4, 3, 200, 200))
    everywhere = np.ones((200, 200), bool)
    assert errors(images, halves, everywhere) == pytest.approx([4, 4, 4], rel=0.02)
    assert np.isnan(errors(halves.mean(0)[None], halves, everywhere)).all()
    assert psnr(np.array([0.01, 0.01])) == pytest.approx(20) and math.isnan(psnr(np.nan))


def test_edges_are_where_brightness_or_depth_steps():
    truth, depth = np.ones((3, 20, 20)), np.ones((20, 20))
    truth[:, :, 10:] = 4
    depth[5:] = 2
    found = edges_of(truth, depth)
    assert found[0, 9] and found[0, 10] and found[4, 0] and found[5, 0]
    assert not found[0, 0] and not found[15, 15]
