"""Blurs without occlusion: every method is the same convolution over depths and bands."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy.signal import convolve2d

from benchmarks.brute import brute
from edofsim.capture import convolution
from edofsim.capture.blurring import Blurring
from edofsim.capture.convolution import Grid, fast_length
from edofsim.capture.light import hat_weights, light_of, seen
from edofsim.capture.occlusion import OCCLUSIONS

BANDS, WINDOW, MARGIN = 4, 17, 8
NODES = torch.linspace(0, 2, 9, dtype=torch.float64)


@pytest.fixture(params=["brute", "layered"])
def method(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """Blurs by layers, or, pair of depth and band by pair, by brute force."""
    if request.param == "brute":
        monkeypatch.setattr("edofsim.capture.blurring.layered", brute)
    return request.param


def blurring(bench, nodes=NODES, window=WINDOW, channels=3, **settings) -> Blurring:
    return Blurring(bench.kernels(nodes, BANDS, window), bench.response(channels, BANDS), **settings)


def photo(view, blur: Blurring):
    return view.crop_margin(OCCLUSIONS["none"](view, blur))


def deep_view(bench, height=26, width=31, margin=MARGIN):
    rows, columns = height + 2 * margin, width + 2 * margin
    depth = torch.linspace(0, 2, columns, dtype=torch.float64).expand(rows, columns)
    return bench.flat_view(bench.texture(BANDS, rows, columns), depth, margin)


def test_methods_equal_direct_convolution(bench, method):
    """The paper's Eq. `Forwardmodel` summed over depths and bands, against scipy's direct convolution."""
    view = deep_view(bench, height=12, width=13)
    psfs, response = bench.gaussian_psfs(NODES, BANDS, WINDOW).numpy(), bench.response(3, BANDS).numpy()
    image = view.all_in_focus().numpy()
    rows, columns = view.padded_shape
    cell, share = (a.reshape(rows, columns).numpy() for a in hat_weights(view.inverse_depth, NODES))
    expected = np.zeros((3, rows, columns))
    for k in range(len(NODES)):
        weight = np.where(cell == k, 1 - share, 0) + np.where(cell == k - 1, share, 0)
        for band in range(BANDS):
            blurred = convolve2d(image[band] * weight, psfs[k, band], mode="same")
            expected += response[:, band, None, None] * blurred
    got = photo(view, blurring(bench))
    assert np.abs(got.numpy() - view.crop_margin(torch.from_numpy(expected)).numpy()).max() < 2e-6


@pytest.mark.parametrize("window", [16, 17])
@pytest.mark.parametrize(("height", "width"), [(20, 21), (21, 20), (23, 23)])
def test_point_source_gives_the_psf_of_its_depth_and_band(bench, method, window, height, width):
    """An asymmetric PSF appears where the point is, the right way up, for odd and even windows and frames."""
    margin, rows, columns = 8, height + 16, width + 16
    image = torch.zeros(BANDS, rows, columns, dtype=torch.float64)
    row, column = margin + 9, margin + 10
    image[2, row, column] = 3.0
    view = bench.flat_view(image, float(NODES[6]), margin)
    kernels = bench.kernels(NODES, BANDS, window)
    y = torch.arange(window, dtype=torch.float64)
    values = kernels.values * (1 + 0.5 * torch.tanh((y[:, None] - 5) / 3) + 0.3 * torch.tanh((y - 11) / 2))
    kernels = type(kernels)(values, NODES, kernels.wavelengths)
    response = bench.response(3, BANDS)
    blur = Blurring(kernels, response)
    got = OCCLUSIONS["none"](view, blur)
    c = window // 2
    expected = torch.zeros_like(got)
    patch = response[:, 2, None, None] * values[6, 2] * 3.0
    expected[:, row - c : row - c + window, column - c : column - c + window] = patch
    assert torch.allclose(view.crop_margin(got), view.crop_margin(expected), atol=1e-6)


def test_constant_scene_stays_constant_to_the_edge_of_the_frame(bench, method):
    """Radiance 1 everywhere at one depth: every pixel of the frame, the outermost too, sees 1."""
    view = bench.flat_view(torch.ones(BANDS, 40, 43, dtype=torch.float64), 1.6, MARGIN)
    assert (photo(view, blurring(bench)) - 1).abs().max() < 1e-5


def test_light_does_not_wrap_around_a_frame_without_margin(bench):
    """A point at one side of a frame without a margin leaves the other side dark."""
    image = torch.zeros(BANDS, 24, 24, dtype=torch.float64)
    image[:, 1, 1] = 1
    view = bench.flat_view(image, 2.0, 0)
    got = photo(view, blurring(bench))
    assert got[:, 12:, :].abs().max() < 1e-14
    assert got[:, :, 12:].abs().max() < 1e-14


def test_energy_is_kept(bench, method):
    """All light of a point well inside the padded frame arrives: PSFs that sum to 1 lose nothing."""
    image = torch.zeros(BANDS, 60, 61, dtype=torch.float64)
    image[:, 30, 28] = torch.tensor([1.0, 2.0, 3.0, 4.0], dtype=torch.float64)
    view = bench.flat_view(image, 1.3, MARGIN)
    total = photo(view, blurring(bench)).sum((1, 2))
    assert torch.allclose(total, bench.response(3, BANDS) @ image[:, 30, 28], rtol=1e-9)


def test_linear_in_the_radiance(bench, method):
    view = deep_view(bench)
    other = bench.flat_view(bench.texture(BANDS, *view.padded_shape, seed=3), 1.0, MARGIN).radiance
    blur = blurring(bench)
    from dataclasses import replace

    one, two = photo(view, blur), photo(replace(view, radiance=other), blur)
    both = photo(replace(view, radiance=2.5 * view.radiance - 0.5 * other), blur)
    assert torch.allclose(both, 2.5 * one - 0.5 * two, atol=1e-12)


def test_one_depth_costs_one_convolution_a_band(bench, method, monkeypatch):
    """A flat scene whose depth is the one node: exactly one convolution a band, and the layered result."""
    counted = []
    real = convolution.add_convolved

    def counting(total, light, psf, weights, grid):
        counted.append(len(light))
        return real(total, light, psf, weights, grid)

    module = {"brute": "benchmarks.brute", "layered": "edofsim.capture.layers"}[method]
    monkeypatch.setattr(f"{module}.add_convolved", counting)
    view = bench.flat_view(bench.texture(BANDS, 40, 43), 1.6, MARGIN)
    one = torch.tensor([1.6], dtype=torch.float64)
    got = photo(view, blurring(bench, nodes=one))
    assert sum(counted) == BANDS
    between = torch.tensor([1.0, 1.6, 2.0], dtype=torch.float64)
    assert torch.allclose(got, photo(view, blurring(bench, nodes=between)), atol=1e-6)


def test_float32_agrees_with_float64(bench):
    view = deep_view(bench)
    kernels, response = bench.kernels(NODES, BANDS, WINDOW), bench.response(3, BANDS)
    exact = photo(view, Blurring(kernels, response))
    single = Blurring(type(kernels)(kernels.values.float(), NODES, kernels.wavelengths), response.float())
    got = photo(view.to(dtype=torch.float32), single)
    assert got.dtype == torch.float32
    assert (got - exact).abs().max() < 5e-6


def test_empty_light_is_dark(bench, method):
    view = deep_view(bench)
    nothing = blurring(bench).light(view, seen(view)[:0])
    assert nothing.shape == (3, *view.padded_shape)
    assert not nothing.any()


def test_light_knows_its_nodes(bench):
    """Fragments on nodes occupy one node each, fragments between nodes two; images by node add up to all."""
    view = deep_view(bench)
    light = light_of(view, NODES, seen(view))
    assert light.occupied_nodes() == list(range(9))
    total = sum(light.at_node(k) for k in range(9))
    assert torch.allclose(total, view.all_in_focus(), atol=1e-14)
    on_node = bench.flat_view(torch.ones(1, 5, 5, dtype=torch.float64), 0.75, 0)
    assert light_of(on_node, NODES, seen(on_node)).occupied_nodes() == [3]


def test_grid_is_no_larger_than_the_frame_when_the_margin_holds_the_blur():
    assert Grid(640, 640, 64, 128).transform == (640, 640)
    assert Grid(640, 640, 0, 128).transform[0] >= 640 + 64
    assert fast_length(1) == 1
    assert fast_length(121) == 125
    assert fast_length(121, even=True) == 126


def test_gradients_reach_radiance_and_psfs(bench):
    view = deep_view(bench, 6, 7, margin=4)
    base = bench.kernels(NODES[:3], BANDS, 7)

    def picture(radiance, values):
        from dataclasses import replace

        kernels = type(base)(values, NODES[:3], base.wavelengths)
        blur = Blurring(kernels, bench.response(2, BANDS))
        return photo(replace(view, radiance=radiance), blur)

    radiance = view.radiance.clone().requires_grad_()
    values = base.values.clone().requires_grad_()
    assert torch.autograd.gradcheck(picture, (radiance, values), fast_mode=True)
