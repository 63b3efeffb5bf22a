"""Spectra that three channels leave open are taken to be as smooth as they can be."""

from __future__ import annotations

import numpy as np
import torch

from edofsim.optics import Camera, response
from edofsim.recipe.camera import CameraRecipe
from edofsim.restore.photograph_statistics import colour_weights, smoothest_spectra

BANDS = torch.cat([torch.arange(420, 561, 10), torch.arange(580, 721, 20)]).double() * 1e-9
WEIGHTS = response(Camera.from_recipe(CameraRecipe(name="c")), BANDS)


def _change(spectrum: np.ndarray) -> float:
    """Integral of the squared slope between bands, nanometres."""
    return float((np.diff(spectrum) ** 2 / np.diff(BANDS.numpy() * 1e9)).sum())


def test_a_spectrum_has_its_colour_and_none_of_that_colour_is_smoother() -> None:
    spectra = smoothest_spectra(BANDS, WEIGHTS)
    torch.testing.assert_close(WEIGHTS @ spectra, torch.eye(3).double(), rtol=0, atol=1e-9)
    torch.testing.assert_close(spectra.sum(1), torch.ones(len(BANDS)).double())  # white is even
    unseen = np.linalg.svd(WEIGHTS.numpy())[2][3:]  # changes of a spectrum that no channel sees
    random = np.random.default_rng(5)
    for colour in random.uniform(size=(10, 3)):
        own = spectra.numpy() @ colour
        for _ in range(20):
            assert _change(own + 0.01 * random.normal(size=len(unseen)) @ unseen) > _change(own)


def test_of_lines_each_channel_sees_its_own() -> None:
    lines = torch.tensor([611e-9, 543e-9, 482e-9])
    seen = colour_weights(lines, torch.eye(3).double()).unflatten(0, (3, 3))
    expected = torch.zeros(3, 3, 3).double()
    expected[range(3), range(3), range(3)] = 1
    torch.testing.assert_close(seen, expected)


def test_colours_that_are_seen_alike_do_no_harm() -> None:
    """A sensor whose channels are one and the same, and fewer bands than channels."""
    two = WEIGHTS[:, :2] / WEIGHTS[:, :2].sum(1)[:, None]
    for weights in (WEIGHTS[:1].repeat(3, 1), torch.ones(3, 1).double(), two):
        spectra = smoothest_spectra(BANDS[: weights.shape[1]], weights)
        assert torch.isfinite(spectra).all()
        torch.testing.assert_close(spectra.sum(1), torch.ones(weights.shape[1]).double())
