"""The networks' shape and size, and that tiles do not show."""

from __future__ import annotations

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from edofsim.errors import InputError
from edofsim.restore.network import NETWORKS, apply_network, build_network, weights_of


def _random_network(kind: str) -> torch.nn.Module:
    """A network with no zero weights, so that every path in it matters."""
    torch.manual_seed(3)
    network = build_network(kind)
    generator = torch.Generator().manual_seed(3)
    with torch.no_grad():
        for parameter in network.parameters():
            parameter.add_(0.05 * torch.randn(parameter.shape, generator=generator))
    return network.eval()


def test_dcnn_has_as_many_weights_as_the_paper_describes() -> None:
    """Counted from Akpinar et al.: blocks of 3x3 convolution with bias and batch normalisation, the
    convolution to 3 channels, two transposed 3 -> 3 convolutions."""
    blocks = (3 * 32 * 9 + 32 + 2 * 32) + 4 * (32 * 32 * 9 + 32 + 2 * 32)
    assert blocks + (32 * 3 * 9 + 3) + 2 * (3 * 3 * 9 + 3) == 39243
    assert weights_of(build_network("dcnn")) == 39243


def test_the_stronger_network_ships_in_under_2_megabytes() -> None:
    assert 4 * weights_of(build_network("local-unet")) < 2_000_000
    bank = build_network("filter-bank")
    assert 4 * (weights_of(bank) + bank.filters.numel()) < 2_000_000


def test_a_bank_of_filters_is_a_convolution_that_continues_the_border() -> None:
    bank = build_network("filter-bank", {"groups": 3, "support": 7})
    bank.filters.copy_(torch.randn(bank.filters.shape, generator=torch.Generator().manual_seed(6)))
    photo = torch.rand(2, 3, 21, 34, generator=torch.Generator().manual_seed(7))
    padded = torch.nn.functional.pad(photo, (3, 3, 3, 3), mode="replicate")
    expected = torch.nn.functional.conv2d(padded, bank.filters)
    torch.testing.assert_close(bank.filtered(photo).flatten(1, 2), expected, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("kind", NETWORKS)
@settings(max_examples=8, deadline=None)
@given(rows=st.integers(1, 40), columns=st.integers(1, 40))
def test_any_size_in_same_size_out(kind: str, rows: int, columns: int) -> None:
    photo = torch.rand(1, 3, rows, columns, generator=torch.Generator().manual_seed(1))
    with torch.no_grad():
        restored = _random_network(kind)(photo)
    assert restored.shape == photo.shape
    assert restored.min() >= 0 and restored.max() <= 1


@pytest.mark.parametrize("kind", NETWORKS)
def test_an_untrained_network_returns_its_photo(kind: str) -> None:
    """Networks add a residual to the photo; the U-Net's starts at zero, the D-CNN's is small. The filter
    starts without a blur to remove and smooths a little, for its noise."""
    photo = torch.rand(3, 32, 32, generator=torch.Generator().manual_seed(2))
    restored = apply_network(build_network(kind), photo)
    most = {"dcnn": 0.15, "local-unet": 1e-6, "filter-bank": 1e-6, "wiener": 0.05}
    assert (restored - photo).abs().mean() < most[kind]


@pytest.mark.parametrize("kind", ["dcnn", "local-unet", "filter-bank"])
def test_a_pixel_sees_no_further_than_the_radius(kind: str) -> None:
    """The gradient of one output pixel is zero outside the radius, and not zero near it (D-CNN: at it)."""
    network = _random_network(kind)
    with torch.no_grad():  # a smaller residual keeps the sum away from the clamp
        (network.residual[-1] if kind == "dcnn" else network.trunk.last).weight.mul_(0.05)
    # filters that are told apart, so that the choice among them matters
    if kind == "filter-bank":
        network.filters.mul_(torch.linspace(0.9, 1.1, len(network.filters))[:, None, None, None])
    size = 2 * network.radius + 2 * network.multiple + 9
    photo = torch.full((1, 3, size, size), 0.5, requires_grad=True)
    centre = size // 2
    network(photo)[0, 1, centre, centre].backward()
    gradient = photo.grad[0].abs().sum(0)
    # Fourier transforms leave rounding everywhere
    least = 1e-5 * gradient.max() if kind == "filter-bank" else 0.0
    seen = (gradient > least).nonzero() - centre
    assert seen.abs().max() <= network.radius
    if kind == "dcnn":
        assert seen.abs().max() == network.radius


@pytest.mark.parametrize("kind", NETWORKS)
def test_tiles_give_the_whole_photo(kind: str) -> None:
    network = _random_network(kind)
    photo = torch.rand(3, 150, 197, generator=torch.Generator().manual_seed(4))
    whole = apply_network(network, photo, tile=256)
    tiled = apply_network(network, photo, tile=64)
    # Fourier transforms of other sizes round otherwise, and these weights magnify it
    assert torch.allclose(tiled, whole, atol=1e-5 if kind == "filter-bank" else 1e-6)


def test_the_untrained_shape_is_checked_before_the_work() -> None:
    network = build_network("dcnn")
    with pytest.raises(InputError, match=r"3 channels"):
        apply_network(network, torch.rand(1, 16, 16))
    with pytest.raises(InputError, match="finite"):
        apply_network(network, torch.full((3, 16, 16), torch.nan))
    with pytest.raises(InputError, match="local-unet"):
        build_network("unet")
    with pytest.raises(InputError, match="cannot be built"):
        build_network("dcnn", {"kernels": 64})
