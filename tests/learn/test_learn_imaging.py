"""Patches are photographed as Eq. `Forwardmodel` says, with nothing wrapped round."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy.signal import convolve2d

from edofsim.capture.planes import capture_planes, surroundings


@pytest.mark.parametrize("window", [1, 5, 8])
def test_a_patch_is_cut_from_the_whole_convolution(window: int) -> None:
    """Against scipy's direct convolution of the whole picture; the patch with its surroundings is enough."""
    generator = np.random.default_rng(1)
    picture, psf = generator.random((40, 37)), generator.random((window, window))
    psf /= psf.sum()
    full = convolve2d(picture, psf)  # pixel i of the photo is at i + window // 2, the centre of the PSF
    before, after = surroundings(window)
    top, left, rows, columns = 12, 11, 9, 14
    cut = picture[top - before : top + rows + after, left - before : left + columns + after]
    photo = capture_planes(torch.from_numpy(cut)[None, None], torch.from_numpy(psf)[None, None])[0, 0].numpy()
    centre = window // 2
    expected = full[top + centre : top + centre + rows, left + centre : left + centre + columns]
    np.testing.assert_allclose(photo, expected, atol=1e-12)


def test_light_goes_where_the_psf_says() -> None:
    """A PSF whose light lies one pixel to the right of its centre moves the picture to the right."""
    psf = torch.zeros(1, 1, 6, 6)
    psf[..., 3, 4] = 1
    sharp = torch.rand(1, 1, 15, 15, generator=torch.Generator().manual_seed(0))
    before, _ = surroundings(6)
    photo = capture_planes(sharp, psf)
    assert torch.allclose(photo, sharp[..., before : before + 10, before - 1 : before + 9], atol=1e-6)


def test_a_channel_adds_up_what_it_sees_of_each_colour() -> None:
    """Against a photo of each colour alone; what a window does not hold of it is a veil, too."""
    generator = torch.Generator().manual_seed(4)
    sharp = torch.rand(2, 3, 15, 14, generator=generator)
    psf = torch.rand(2, 3, 3, 6, 6, generator=generator) / 60
    photo = capture_planes(sharp, psf)
    inside = sharp[..., 2:12, 2:11]
    assert photo.shape == inside.shape
    means = sharp.mean((-1, -2))
    for channel in range(3):
        expected = means[:, channel, None, None].expand(2, 10, 9).clone()
        for colour in range(3):
            seen = capture_planes(sharp[:, [colour]], psf[:, channel, [colour]])[:, 0]
            expected += seen - means[:, colour, None, None]
        torch.testing.assert_close(photo[:, channel], expected)
    white = capture_planes(torch.ones(2, 3, 15, 14), psf)
    torch.testing.assert_close(white, torch.ones_like(white))


def test_light_beyond_the_window_is_a_veil() -> None:
    """Against a window that holds all the light: a point with a halo that is wider than the small window."""
    wide, small = 241, 9
    generator = np.random.default_rng(2)
    picture = np.pad(generator.random((60, 60)), 120, "wrap")[1:, 1:]  # 60 pixels, again and again
    halo = np.full((wide, wide), 0.1 / wide**2)
    halo[wide // 2, wide // 2] += 0.9
    exact = convolve2d(picture, halo, "valid")
    before, after = surroundings(small)
    middle = (picture.shape[0] - exact.shape[0]) // 2
    rows = slice(middle - before, middle + exact.shape[0] + after)
    core = halo[wide // 2 - small // 2 : wide // 2 + small // 2 + 1][:, wide // 2 - 4 : wide // 2 + 5]
    cut, psf = (torch.from_numpy(a.copy())[None, None] for a in (picture[rows, rows], core))
    photo = capture_planes(cut, psf)[0, 0].numpy()
    lost = 1 - core.sum()
    error = np.abs(photo - exact)
    assert error.max() < 0.03 * lost
