"""Networks that grow out of smaller ones: at first they restore as those do."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch
from torch import Tensor, nn
from torch.nn.functional import conv2d

from edofsim.errors import InputError
from edofsim.restore.borders import continued
from edofsim.restore.checkpoint import load_checkpoint, save_checkpoint
from edofsim.restore.dcnn import DCnn
from edofsim.restore.filter_bank import FilterBank
from edofsim.restore.network import apply_network, build_network
from edofsim.restore.photograph_statistics import power_spectrum

WIDER = {"kernels": 40, "dilations": [1, 2, 3, 4, 2, 1]}


def _photo(seed: int, *shape: int) -> Tensor:
    return torch.rand(*shape, generator=torch.Generator().manual_seed(seed))


def _shaken(network: nn.Module, seed: int = 3, by: float = 0.05) -> nn.Module:
    """With no zero weights, so that every path in it matters."""
    generator = torch.Generator().manual_seed(seed)
    with torch.no_grad():
        for parameter in network.parameters():
            parameter.add_(by * torch.randn(parameter.shape, generator=generator))
    return network.eval()


def _small_bank() -> FilterBank:
    bank = build_network(
        "filter-bank", {"groups": 4, "distances": 1, "support": 9, "width": 4, "blocks": [1]}
    )
    assert isinstance(bank, FilterBank)
    psf = torch.zeros(4, 3, 9, 9)
    for reach in range(4):
        psf[reach, :, 4 - reach : 5 + reach, 4 - reach : 5 + reach] = 1 / (2 * reach + 1) ** 2
    filters = 0.02 * torch.randn(4, 3, 3, 9, 9, generator=torch.Generator().manual_seed(8))
    filters[:, range(3), range(3), 4, 4] += torch.linspace(0.5, 0.9, 4)[:, None]
    bank.set_filters(filters, psf)
    _shaken(bank.trunk)
    return bank.eval()


def test_more_kernels_change_nothing_at_first() -> None:
    small = _shaken(DCnn()).double()
    assert isinstance(small, DCnn)
    for name, statistics in small.named_buffers():
        if "running" in name:
            statistics.copy_(0.5 + _photo(5, *statistics.shape))
    large = DCnn.grown(small, {"kernels": 40}).eval().double()
    photo = _photo(1, 1, 3, 20, 24).double()
    torch.testing.assert_close(large.unclamped(photo), small.unclamped(photo), rtol=0, atol=1e-12)
    assert large.settings() == {"kernels": 40, "dilations": [1, 2, 3, 2, 1]}
    large.unclamped(photo).square().mean().backward()
    # what is new learns: what it gives counts for nothing yet, and its gradient is not zero
    assert large.residual[3].weight.grad[:32, 32:].abs().max() > 0


def test_more_blocks_hand_on_what_they_get() -> None:
    """All that is not negative; the rest they make a hundred times smaller, as the leak does."""
    small = _shaken(DCnn())
    with torch.no_grad():  # no negative values: the leak, and so the new block, has nothing to do
        for parameter in small.residual.parameters():
            parameter.abs_()
    assert isinstance(small, DCnn)
    large = DCnn.grown(small, WIDER).eval()
    photo = _photo(2, 1, 3, 60, 60).double()
    assert large.radius == small.radius + 4
    inside = slice(large.radius, -large.radius)  # beyond the border a photo goes on farther for a larger one
    found, expected = (net.double().unclamped(photo)[..., inside, inside] for net in (large, small))
    torch.testing.assert_close(found, expected, rtol=1e-7, atol=0)


def test_a_d_cnn_that_does_not_fit_is_refused() -> None:
    small = DCnn()
    for settings in ({"kernels": 16}, {"dilations": [1, 2, 3]}, {"dilations": [2, 1, 2, 3, 2, 1]}):
        with pytest.raises(InputError, match="does not fit"):
            DCnn.grown(small, settings)
    with pytest.raises(InputError, match="not out of a 'local-unet'"):
        DCnn.grown(build_network("local-unet"), WIDER)


def test_a_large_d_cnn_is_rebuilt_by_its_checkpoint(tmp_path: Path) -> None:
    large = _shaken(DCnn.grown(DCnn(), WIDER))
    path = save_checkpoint(tmp_path / "large.safetensors", large, {"name": "large"})
    found, photo = load_checkpoint(path).network, _photo(4, 3, 40, 30)
    assert torch.equal(apply_network(found, photo), apply_network(large, photo))


def test_fixed_statistics_are_folded_in_training_too() -> None:
    """With gradients, in float64: as layer by layer."""
    network = _shaken(DCnn()).double()
    photo = _photo(6, 1, 3, 18, 22).double()
    gradients = []
    for folded in (True, False):
        network.zero_grad()
        if folded:
            image = network.unclamped(photo)
        else:
            beyond = network._sharp(continued(photo, network.radius), None)
            reach = network.radius
            image = beyond[..., reach:-reach, reach:-reach]
        image.pow(3).sum().backward()
        gradients.append([p.grad.clone() for p in network.parameters()])
    for first, second in zip(*gradients, strict=True):
        torch.testing.assert_close(first, second, rtol=1e-8, atol=1e-8)


def test_filters_are_applied_as_a_convolution_does() -> None:
    """In training too, where what is known of them is kept, and after they are replaced."""
    bank = _small_bank()
    photo = _photo(3, 2, 3, 37, 30)
    padded = torch.nn.functional.pad(photo, (4,) * 4, mode="replicate").double()
    for training in (False, True):
        bank.train(training)
        for _ in range(2):
            expected = conv2d(padded, bank.filters.double()).unflatten(1, (-1, 3))
            torch.testing.assert_close(bank.filtered(photo).double(), expected, rtol=0, atol=1e-5)
            bank.filters = bank.filters.flip(-1)


TOLD = {"distances": 4}


def _blurs(count: int) -> Tensor:
    """Squares of 1, 3, 5, ... pixels, [count, 3, 17, 17]."""
    psf = torch.zeros(count, 3, 17, 17)
    for reach in range(count):
        psf[reach, :, 8 - reach : 9 + reach, 8 - reach : 9 + reach] = 1 / (2 * reach + 1) ** 2
    return psf


def _texture(size: int, seed: int) -> Tensor:
    """Grey, with the spectrum of photographs, [1, 3, size, size]."""
    white = torch.fft.rfft2(torch.randn(size, size, generator=torch.Generator().manual_seed(seed)))
    return torch.fft.irfft2(white * power_spectrum(size, torch.zeros(1)).sqrt()).expand(1, 3, -1, -1)


def test_a_d_cnn_is_told_how_likely_each_distance_is() -> None:
    """Of four blurs, each at two distances, it sees that of the photo; nothing where it asks for none."""
    network = DCnn(**TOLD).eval()
    assert network.psfs == "mean" and DCnn().psfs == "none"
    assert DCnn().likely(torch.zeros(1, 3, 40, 40)) is None
    network.set_psfs(_blurs(4).repeat_interleave(2, 0))
    for part in range(4):
        photo = torch.nn.functional.avg_pool2d(_texture(128, 9), 2 * part + 1, 1)
        noise = 0.003 * torch.randn(photo.shape, generator=torch.Generator().manual_seed(2))
        likely = network.likely(photo + noise)
        assert torch.allclose(likely.sum(1), torch.ones(1), atol=1e-5)
        assert likely[:, part].mean() > 0.9


def test_each_distance_has_channels_of_its_own() -> None:
    """A network that adds the number of the likely part of the range, in tenths, to each pixel."""
    network = DCnn(**TOLD).eval()
    network.set_psfs(_blurs(4).repeat_interleave(2, 0))
    last = network.residual[-1]
    with torch.no_grad():
        last.weight.zero_()
        last.bias.copy_(0.1 * torch.arange(4).repeat_interleave(3))
    for part in range(4):
        photo = torch.nn.functional.avg_pool2d(_texture(128, 9), 2 * part + 1, 1)
        noise = 0.003 * torch.randn(photo.shape, generator=torch.Generator().manual_seed(2))
        with torch.no_grad():
            added = network.unclamped(photo + noise) - (photo + noise)
        assert float(added[..., 16:-16, 16:-16].mean()) == pytest.approx(0.1 * part, abs=0.02)


def test_what_it_is_told_changes_nothing_at_first_and_is_kept(tmp_path: Path) -> None:
    small = _shaken(DCnn())
    told = DCnn.grown(small, TOLD).eval()
    told.set_psfs(_blurs(8))
    photo = _photo(3, 3, 70, 60)
    torch.testing.assert_close(apply_network(told, photo), apply_network(small, photo), rtol=0, atol=1e-5)
    _shaken(told)
    path = save_checkpoint(tmp_path / "told.safetensors", told, {"name": "told"})
    found = load_checkpoint(path).network
    assert torch.equal(apply_network(found, photo), apply_network(told, photo))
    larger = DCnn.grown(told, {"kernels": 40}).eval()
    torch.testing.assert_close(apply_network(larger, photo), apply_network(told, photo), rtol=0, atol=1e-5)
    with pytest.raises(InputError, match="does not fit"):
        DCnn.grown(told, {"distances": 8})


def test_a_told_d_cnn_restores_in_tiles_as_whole() -> None:
    told = DCnn.grown(_shaken(DCnn()), TOLD).eval()
    told.set_psfs(_blurs(8))
    _shaken(told, by=0.1)
    photo = torch.nn.functional.avg_pool2d(_texture(304, 5), 5, 1)[0] * 0.02 + 0.5
    whole, tiles = (apply_network(told, photo, tile=tile) for tile in (512, 96))
    torch.testing.assert_close(tiles, whole, rtol=0, atol=1e-5)


def test_gradients_reach_the_photo_through_a_told_d_cnn() -> None:
    """A mask that learns with it needs them; what it is told has none."""
    told = _shaken(DCnn(**TOLD)).train()
    photo = _photo(8, 1, 3, 48, 48).requires_grad_()
    told(photo).square().sum().backward()
    assert photo.grad is not None and photo.grad.abs().mean() > 1e-3
