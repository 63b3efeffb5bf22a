"""Factors of PSFs: their error is known beforehand, they follow PSFs that change, and they are kept."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from edofsim.capture import Fidelity, capture, factor_cache
from edofsim.capture.factor_cache import factors_for
from edofsim.capture.factors import band_groups, factorise, joint_groups, measured_db, refreshed
from edofsim.capture.kernels import StreamedKernels
from edofsim.capture.prepare import kernels_of
from edofsim.optics import Camera
from edofsim.recipe import load_camera
from edofsim.render.view import View
from edofsim.restore.checkpoint import load_checkpoint

NODES = torch.linspace(0, 2, 12, dtype=torch.float64)
BANDS, WINDOW = 4, 17


def all_psfs(factors, bands: int):
    """What factors say the PSFs of a joint group are, weighted: [node, band, y, x]."""
    return torch.einsum("kdb,kyx->dbyx", factors.coefficients, factors.basis)


@pytest.mark.parametrize("way", [joint_groups, band_groups])
def test_predicted_error_is_the_measured_one_at_the_worst_node(bench, way):
    kernels, response = bench.kernels(NODES, BANDS, WINDOW), bench.response(3, BANDS)
    for each in factorise(kernels, [way(response)], 45.0):
        assert each.predicted_db >= 45
        # the term that keeps the energy may only add to what was predicted without it
        assert measured_db(each, kernels, list(range(12))) == pytest.approx(each.predicted_db, abs=1.5)


@pytest.mark.parametrize("wavelength", [482e-9, 543e-9])
def test_single_precision_takes_as_few_terms_as_double(wavelength: float):
    """PSFs that hardly differ, through a mask that evens out distance: sums that lose what is small beside
    their mean need three times the terms, and say of none that it is enough."""
    camera = load_camera("paper-learned")
    optics = Camera.from_recipe(camera.recipe, camera.base)
    nodes = torch.linspace(0.2, 1.8, 24, dtype=torch.float64)
    bands = torch.tensor([wavelength], dtype=torch.float64)
    found = []
    for dtype in (torch.float32, torch.float64):
        kernels = kernels_of(optics, bands, nodes, 128, dtype=dtype)
        (factors,) = factorise(kernels, [joint_groups(torch.ones(1, 1, dtype=dtype))], 50.0)
        found.append(factors)
        assert factors.predicted_db >= 50
        assert measured_db(factors, kernels, list(range(24))) == pytest.approx(factors.predicted_db, abs=1.5)
    single, double = found
    assert single.rank == double.rank
    assert single.predicted_db == pytest.approx(double.predicted_db, abs=0.1)


def test_photos_by_low_rank_do_not_hang_on_rounding():
    """Heights that differ by rounding make the same photo, to a hundred times that."""
    camera = load_camera("paper-learned")
    optics = Camera.from_recipe(camera.recipe, camera.base)
    height = load_checkpoint("paper-dcnn").height.double()
    draw = torch.Generator().manual_seed(0)
    size = 96 + 128
    view = View.flat(
        torch.rand(1, size, size, generator=draw),
        torch.linspace(0.2, 1.8, size)[:, None].expand(size, size),
        wavelengths=[543e-9],
        pixel_angle=optics.pixel_angle,
        margin=64,
    )
    low = Fidelity(method="low_rank", occlusion="none", layers_db=50.0, rank_db=50.0)
    one, two = (
        capture(view, optics.with_height(h), low, exposure=1.0).clean for h in (height, height * (1 + 1e-7))
    )
    assert (one - two).abs().max() < 1e-5 * one.abs().max()


def test_factors_keep_the_energy_of_every_psf(bench):
    kernels, response = bench.kernels(NODES, BANDS, WINDOW), bench.response(3, BANDS)
    kernels = replace(
        kernels, values=kernels.values * torch.linspace(1, 0.8, 12).double()[:, None, None, None]
    )
    for each in factorise(kernels, [joint_groups(response)], 30.0):
        wanted = kernels.values.sum((2, 3))[:, each.group.bands] * each.group.weights
        assert torch.allclose(all_psfs(each, BANDS).sum((2, 3)), wanted, rtol=1e-12)


def test_a_basis_from_some_nodes_serves_all(bench, monkeypatch):
    """Where there are many PSFs the basis is made from some, and from more where these are too few; the error
    is that of all."""
    monkeypatch.setattr("edofsim.capture.factors.MOST_PSFS", 5 * BANDS)
    nodes = torch.linspace(0, 2, 41, dtype=torch.float64)
    kernels, response = bench.kernels(nodes, BANDS, WINDOW), bench.response(3, BANDS)
    for each in factorise(kernels, [joint_groups(response)], 45.0):
        assert 5 < len(each.sources) < 41
        assert each.predicted_db >= 45
        assert measured_db(each, kernels, list(range(41))) > 43.5


def test_streamed_psfs_have_the_factors_of_held_ones(bench):
    held, response = bench.kernels(NODES, BANDS, WINDOW), bench.response(3, BANDS)
    streamed = StreamedKernels(
        lambda depths: bench.gaussian_psfs(depths, BANDS, WINDOW), NODES, held.wavelengths, WINDOW
    )
    one, two = (factorise(kernels, [joint_groups(response)], 50.0) for kernels in (held, streamed))
    for a, b in zip(one, two, strict=True):
        assert torch.allclose(all_psfs(a, BANDS), all_psfs(b, BANDS), atol=1e-12)


def test_refreshed_factors_follow_psfs_that_changed_a_little(bench):
    """As a DOE's do between training steps: the error stays near what it was, the energy is that of the new
    PSFs, and gradients reach them; factors that are not refreshed fall behind."""
    kernels, response = bench.kernels(NODES, BANDS, WINDOW), bench.response(3, BANDS)
    moved = bench.gaussian_psfs(NODES, BANDS, WINDOW, growth=4.15) * 0.99
    changed = replace(kernels, values=moved.requires_grad_())
    for each in factorise(kernels, [joint_groups(response)], 45.0):
        now = refreshed(each, changed)
        assert measured_db(now, changed, list(range(12))) > 42
        assert measured_db(now, changed, list(range(12))) > measured_db(each, changed, list(range(12))) + 3
        wanted = moved.detach().sum((2, 3))[:, each.group.bands] * each.group.weights
        assert torch.allclose(all_psfs(now, BANDS).sum((2, 3)).detach(), wanted, rtol=1e-9)
        now.basis.square().sum().backward()
        assert torch.isfinite(changed.values.grad).all()
        assert changed.values.grad.any()


def test_factors_are_computed_once(bench, tmp_path):
    """Kept in memory and in a folder under what they are made from; a damaged file is made again."""
    plain, response = bench.kernels(NODES, BANDS, WINDOW), bench.response(3, BANDS)
    kernels = replace(plain, key="these PSFs", folder=tmp_path)
    calls = []

    def compute():
        calls.append(1)
        return factorise(kernels, [joint_groups(response)], 40.0)

    factor_cache.forget()
    first = factors_for(kernels, response, 40.0, compute)
    factors_for(kernels, response, 40.0, compute)
    assert len(calls) == 1
    factor_cache.forget()
    again = factors_for(kernels, response, 40.0, compute)
    assert len(calls) == 1
    for a, b in zip(first, again, strict=True):
        assert torch.equal(a.basis, b.basis)
        assert torch.equal(a.group.weights, b.group.weights)
        assert a.predicted_db == b.predicted_db
    factors_for(kernels, response, 50.0, compute)
    factors_for(replace(kernels, key="others"), response, 40.0, compute)
    factors_for(kernels, 0.5 * response, 40.0, compute)
    assert len(calls) == 4
    factors_for(plain, response, 40.0, compute)  # no key: nothing may be remembered
    factors_for(plain, response, 40.0, compute)
    assert len(calls) == 6
    factor_cache.forget()
    for file in tmp_path.glob("*.safetensors"):
        file.write_bytes(b"damaged")
    factors_for(kernels, response, 40.0, compute)
    assert len(calls) == 7
    factor_cache.forget()
