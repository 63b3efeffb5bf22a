"""A photo tells how far its places are, from the blur of its three colours."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from skimage import data
from torch import Tensor

from edofsim.capture.planes import capture_planes
from edofsim.optics import PAPER_COLOURS, Camera, psf_bank
from edofsim.restore import blur_likelihood
from edofsim.restore.blur_likelihood import (
    BLOCK,
    CONTRASTS,
    LOWEST,
    STEP,
    block_transfer,
    explain,
    log_likelihood,
    spread,
)
from edofsim.restore.checkpoint import load_checkpoint, trained_camera
from edofsim.restore.photograph_statistics import COLOUR_CORRELATION, power_spectrum, transfer_functions


def _psfs(inverse_depths: list[float]) -> Tensor:
    """Of the learned mask that ships, [depth, 3, 48, 48]."""
    checkpoint = load_checkpoint("paper-dcnn")
    camera = Camera.from_recipe(trained_camera(checkpoint))
    bank = psf_bank(camera.with_height(checkpoint.height), PAPER_COLOURS, inverse_depths, window_px=48)
    return bank.values.to(torch.float32)


def _told(psf: Tensor) -> tuple[Tensor, Tensor]:
    return explain(block_transfer(transfer_functions(psf, 2 * BLOCK)))


def _photo(psf: Tensor, noise: float, seed: int) -> Tensor:
    """A photograph of 128 pixels, sharp in every pixel, at the depth of one PSF [3, y, x]."""
    picture = torch.from_numpy(data.astronaut()[:350, :350].copy()).movedim(-1, 0)[None] / 255
    sharp = torch.nn.functional.avg_pool2d(picture, 2)
    clean = capture_planes(sharp, psf[None])
    return clean + noise * torch.randn(clean.shape, generator=torch.Generator().manual_seed(seed))


def test_it_is_the_density_of_a_gaussian_process() -> None:
    """Against the density written out frequency by frequency, with the noise searched on a fine grid."""
    psf = _psfs([0.2, 1.7])
    photo = _photo(psf[1], 0.01, 1)[..., :BLOCK, :BLOCK].double()
    matrix, constant = _told(psf)
    found = log_likelihood(photo.float(), matrix, constant)[0, :, 0, 0].double().numpy()

    window = np.hanning(BLOCK)[:, None] * np.hanning(BLOCK)
    window /= np.sqrt((window**2).sum())
    block = photo[0].numpy()
    seen = np.fft.rfft2((block - block.mean((1, 2), keepdims=True)) * window)
    transfer = block_transfer(transfer_functions(psf, 2 * BLOCK)).numpy()
    strength = power_spectrum(BLOCK, photo).numpy()
    rows, columns = np.fft.fftfreq(BLOCK) * BLOCK, np.arange(BLOCK // 2 + 1)
    used = [(y, x) for y in range(BLOCK) for x in columns if rows[y] ** 2 + x**2 > LOWEST**2]
    expected = []
    for depth in range(2):
        best = -np.inf
        for contrast in CONTRASTS:
            exponent = logarithm = 0.0
            for y, x in used:
                h = transfer[depth, :, y, x]
                covariance = contrast * strength[y, x] * np.outer(h, h.conj()) * COLOUR_CORRELATION
                covariance = covariance + np.eye(3)
                values = seen[:, y, x]
                exponent += (values.conj() @ np.linalg.solve(covariance, values)).real
                logarithm += np.linalg.slogdet(covariance)[1]
            variance = np.exp(np.linspace(-16, 0, 4001))
            density = -exponent / variance - 3 * len(used) * np.log(variance) - logarithm
            best = max(best, density.max())
        expected.append(best)
    assert found[1] - found[0] == pytest.approx(
        expected[1] - expected[0], abs=0.5
    )  # of thousands, in single precision
    assert expected[1] > expected[0] + 20  # the true depth, by far


@pytest.mark.parametrize(("noise", "least"), [(0.003, 0.8), (0.012, 0.65)])
def test_most_blocks_know_how_far_they_are(noise: float, least: float) -> None:
    """Of 16 distances from 0.5 m to infinity, within one step. Guessing would reach 3 in 16."""
    psf = _psfs([(i + 0.5) / 8 for i in range(16)])
    matrix, constant = _told(psf)
    right = []
    for depth in range(0, 16, 3):
        likely = log_likelihood(_photo(psf[depth], noise, depth), matrix, constant)
        right.append(((likely.argmax(1) - depth).abs() <= 1).double().mean())
    assert torch.stack(right).mean() > least


def test_where_nothing_is_to_be_seen_every_distance_is_as_likely() -> None:
    """Flat, black and overexposed photos, and noise alone: finite, and no distance favoured."""
    matrix, constant = _told(_psfs([0.0, 1.0, 2.0]))
    for level in (0.0, 0.5, 1.0, 1e4):
        likely = log_likelihood(torch.full((1, 3, 64, 48), level), matrix, constant)
        assert likely.shape == (1, 3, 3, 2) and torch.isfinite(likely).all()
        assert (likely - likely.mean(1, keepdim=True)).abs().max() < 2.0 + 1e-3 * likely.abs().max()
    noise = 0.01 * torch.randn(1, 3, 160, 160, generator=torch.Generator().manual_seed(4))
    likely = log_likelihood(noise, matrix, constant).softmax(1)
    assert (likely.mean((0, 2, 3)) > 0.1).all()


def test_contrast_and_brightness_change_nothing() -> None:
    """Half the light with half the noise is the same photo: the likelihood knows neither. To the floor."""
    psf = _psfs([0.2, 1.7])
    matrix, constant = _told(psf)
    photo = _photo(psf[0], 0.01, 2)
    likely, darker = (log_likelihood(each, matrix, constant) for each in (photo, 0.5 * photo + 0.2))
    gap, darker_gap = (each[:, 1] - each[:, 0] for each in (likely, darker))
    assert torch.allclose(gap, darker_gap, atol=0.02 * float(gap.abs().max()))


def test_values_stand_at_the_middles_of_their_blocks() -> None:
    """A plane of values that are their blocks' own middles comes back as the coordinates of the pixels."""
    middle = torch.arange(5) * STEP + (BLOCK - 1) / 2
    across = spread(middle.expand(1, 1, 4, 5))
    assert across.shape == (1, 1, 3 * STEP + BLOCK, 4 * STEP + BLOCK)
    inner = slice(BLOCK // 2, -BLOCK // 2)
    expected = torch.arange(4 * STEP + BLOCK).float()
    assert torch.allclose(across[0, 0, 0, inner], expected[inner], atol=1e-4)


def test_features_are_as_many_as_the_matrix_has() -> None:
    used = int(blur_likelihood._used(torch.device("cpu")).sum())
    matrix, constant = _told(_psfs([0.5]))
    assert matrix.shape == (len(CONTRASTS), 9 * used) and constant.shape == (len(CONTRASTS), 1)
