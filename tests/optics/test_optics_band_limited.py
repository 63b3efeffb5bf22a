"""Functions of depth told by few depths: what PSFs are, as long as a pupil is a disc."""

from __future__ import annotations

import math

import pytest
import torch

from edofsim.optics import Camera, cache, psf, psf_bank
from edofsim.optics.band_limited import band_limited_nodes, band_limited_weights
from edofsim.recipe import CameraRecipe
from edofsim.recipe.camera import PsfSettings


def band_limited(at: torch.Tensor, draw: torch.Generator) -> torch.Tensor:
    """Functions of Psi [function, at], each a sum of waves whose frequencies have a triangle's density on
    [-1, 1]: the mean of their squares is 1."""
    frequency = 1 - torch.rand(500, 16, 1, generator=draw, dtype=torch.float64).sqrt()
    phase = 2 * math.pi * torch.rand(500, 16, 1, generator=draw, dtype=torch.float64)
    return (2 / 16) ** 0.5 * torch.cos(frequency * at + phase).sum(1)


@pytest.mark.parametrize("error", [1e-1, 1e-2, 1e-4])
@pytest.mark.parametrize("span", [0.5, 8.0, 60.0])
def test_error_between_nodes_is_as_asked_for(span, error):
    """Drawn band-limited functions, where the error is largest: as large as asked, and with one node fewer
    larger than that."""
    draw = torch.Generator().manual_seed(0)
    nodes = band_limited_nodes(0.3, 0.3 + span / 40, 40.0, error)
    at = torch.linspace(0.3, 0.3 + span / 40, 400, dtype=torch.float64)
    values = band_limited(40 * torch.cat([at, nodes]), draw)
    weights = band_limited_weights(at, nodes, 40.0)
    assert torch.allclose(weights.sum(1), torch.ones(400, dtype=torch.float64), atol=1e-9)
    found = (values[:, :400] - values[:, 400:] @ weights.T).square().mean(0).sqrt()
    assert float(found.max()) < 1.15 * error
    assert len(nodes) < 4 + span / math.pi + math.log10(1 / error) * 2


def test_nodes_are_as_many_as_two_for_each_wave():
    """Shannon: not fewer than one for each pi of Psi; and hardly more where there are many."""
    nodes = band_limited_nodes(0.0, 2.5, 50.0, 3e-5)
    assert 1 + 125 / math.pi < len(nodes) < 1.3 * 125 / math.pi
    assert float(nodes[0]) == 0.0
    assert float(nodes[-1]) == 2.5
    assert bool((nodes.diff() > 0).all())
    assert band_limited_nodes(1.0, 1.0, 50.0, 1e-3).tolist() == [1.0]


@pytest.mark.parametrize("pieces", [1, 3])
def test_psfs_of_many_depths_are_those_of_each(monkeypatch, pieces):
    """Through a relief without symmetries, against float64, where each depth is computed by itself; the same
    bytes for any number of threads."""
    torch.set_num_threads(pieces)
    cache.forget()
    computed = []
    inner = psf.energies
    monkeypatch.setattr(psf, "energies", lambda wave: computed.append(len(wave.chirps)) or inner(wave))
    settings = PsfSettings(window_px=32, pupil_sampling_um=24.0)
    camera = Camera.from_recipe(CameraRecipe(name="deep", psf=settings))
    draw = torch.Generator().manual_seed(1)
    camera = camera.with_height(1e-6 * torch.rand(40, 40, generator=draw, dtype=torch.float64))
    depths = torch.linspace(0.0, 1.2, 150, dtype=torch.float64)
    exact = psf_bank(camera, [550e-9], depths, dtype=torch.float64).values
    assert sum(computed) == 150
    computed.clear()
    found = psf_bank(camera, [550e-9], depths).values
    assert sum(computed) < 60
    assert (found - exact).abs().max() < 3e-5 * exact.max()
    assert (found - exact).square().sum() < 1e-9 * exact.square().sum()
    torch.set_num_threads(1)
    cache.forget()
    assert torch.equal(found, psf_bank(camera, [550e-9], depths).values)
