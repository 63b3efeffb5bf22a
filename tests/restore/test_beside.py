"""A filter bank with a D-CNN beside it: at first the mean of both, and one file for both."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch
from torch import Tensor, nn

from edofsim.errors import InputError
from edofsim.restore.camera_bank import CameraBank
from edofsim.restore.checkpoint import load_checkpoint, save_checkpoint
from edofsim.restore.dcnn import DCnn
from edofsim.restore.filter_bank import FilterBank
from edofsim.restore.linear import local_filters
from edofsim.restore.network import apply_network

DEPTHS = 4


def _photo(seed: int, *shape: int) -> Tensor:
    return torch.rand(*shape, generator=torch.Generator().manual_seed(seed))


def _shaken(network: nn.Module, seed: int) -> None:
    generator = torch.Generator().manual_seed(seed)
    with torch.no_grad():
        for parameter in network.parameters():
            parameter.add_(0.02 * torch.randn(parameter.shape, generator=generator))


def _blurs(widest: int) -> Tensor:
    """Squares that grow to `widest` pixels to each side, [depth, 3, 9, 9]."""
    psf = torch.zeros(DEPTHS, 3, 9, 9)
    for index in range(DEPTHS):
        reach = index * widest // (DEPTHS - 1)
        psf[index, :, 4 - reach : 5 + reach, 4 - reach : 5 + reach] = 1 / (2 * reach + 1) ** 2
    return psf


def _pair() -> tuple[FilterBank, DCnn]:
    with torch.random.fork_rng():
        torch.manual_seed(0)
        bank = FilterBank(groups=2, distances=2, support=9, width=4, blocks=(1, 1), kernel=3)
        dcnn = DCnn(kernels=6, dilations=(1, 2), distances=2)
    _shaken(bank.trunk, 1)
    _shaken(dcnn, 2)
    for network in (bank, dcnn):
        network.set_psfs(_blurs(3))
    return bank.eval(), dcnn.eval()


def test_at_first_it_gives_the_mean_of_both() -> None:
    bank, dcnn = _pair()
    photo = _photo(3, 1, 3, 72, 80)
    with torch.no_grad():
        found = bank.with_auxiliary(dcnn).unclamped(photo)
        mean = (bank.unclamped(photo) + dcnn.unclamped(photo, rounded=True).clamp(-0.25, 1.25)) / 2
    torch.testing.assert_close(found, mean, rtol=0, atol=1e-5)
    assert (bank.unclamped(photo) - dcnn.unclamped(photo)).abs().mean() > 1e-3


def test_a_training_leaves_the_d_cnn_as_it_is() -> None:
    both = _pair()[0].with_auxiliary(_pair()[1])
    before = {name: value.clone() for name, value in both.state_dict().items()}
    optimiser = torch.optim.Adam([p for p in both.parameters() if p.requires_grad], lr=1e-2)
    photo, sharp = _photo(3, 2, 3, 64, 64), _photo(4, 2, 3, 64, 64)
    for _ in range(2):
        both.train()
        assert both.dcnn is not None and not both.dcnn.training
        loss = (both.unclamped(photo) - sharp).abs().mean()
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
    changed = {name for name, value in both.state_dict().items() if not torch.equal(value, before[name])}
    assert not [name for name in changed if name.startswith("dcnn.")]
    assert {"trunk.first.weight", "trunk.last.weight", "trunk.last.bias"} <= changed
    # what the D-CNN gives, and how much it counts, are learned
    seen = (both.trunk.first.weight - before["trunk.first.weight"])[:, 24:36]
    assert (
        seen.abs().max() > 0 and (both.trunk.last.weight - before["trunk.last.weight"])[12:].abs().max() > 0
    )


def test_a_checkpoint_keeps_both_and_what_they_were_told(tmp_path: Path) -> None:
    both = _pair()[0].with_auxiliary(_pair()[1])
    _shaken(both.trunk, 5)
    path = save_checkpoint(tmp_path / "both.safetensors", both, {"name": "both"})
    photo = _photo(6, 3, 64, 70)
    loaded = load_checkpoint(path).network
    torch.testing.assert_close(apply_network(loaded, photo), apply_network(both, photo), rtol=0, atol=0)


def test_told_other_psfs_both_go_by_them_and_back() -> None:
    both = _pair()[0].with_auxiliary(_pair()[1]).eval()
    photo = _photo(6, 1, 3, 64, 64)
    assert both.dcnn is not None
    with torch.no_grad():
        known, first = both.psf_state(), both.unclamped(photo)
        own = both.dcnn.unclamped(photo)
        both.set_psfs(_blurs(1))
        assert (both.unclamped(photo) - first).abs().max() > 1e-3
        assert (both.dcnn.unclamped(photo) - own).abs().max() > 1e-5
        both.load_psf_state(known)
        torch.testing.assert_close(both.unclamped(photo), first, rtol=0, atol=0)
        torch.testing.assert_close(both.dcnn.unclamped(photo), own, rtol=0, atol=0)


def test_it_restores_in_tiles_as_whole() -> None:
    both = _pair()[0].with_auxiliary(_pair()[1])
    _shaken(both.trunk, 5)
    photo = _photo(7, 3, 32, 240)
    torch.testing.assert_close(
        apply_network(both, photo, tile=64), apply_network(both, photo), rtol=0, atol=2e-6
    )


def test_another_one_beside_takes_the_place_of_the_first() -> None:
    bank, dcnn = _pair()
    both = bank.with_auxiliary(dcnn)
    _shaken(both.trunk, 5)
    other = DCnn(**dcnn.settings())  # pyrefly: ignore[bad-argument-type] - its own
    other.load_state_dict(dcnn.state_dict())
    photo = _photo(6, 1, 3, 64, 64)
    with torch.no_grad():
        same = both.with_auxiliary(other.eval()).eval().unclamped(photo)
        torch.testing.assert_close(same, both.eval().unclamped(photo), rtol=0, atol=0)
        _shaken(other, 9)
        assert (both.with_auxiliary(other).eval().unclamped(photo) - same).abs().max() > 1e-3


def test_a_smaller_one_takes_the_place_of_the_first() -> None:
    """None of the first's blocks is left, and its own are as they were."""
    bank, dcnn = _pair()
    smaller = DCnn(kernels=3, dilations=(1,), distances=2)
    _shaken(smaller, 4)
    smaller.set_psfs(_blurs(3))
    both = bank.with_auxiliary(dcnn).with_auxiliary(smaller)
    assert both.dcnn is not None
    for name, value in both.dcnn.state_dict().items():
        torch.testing.assert_close(value, smaller.state_dict()[name], rtol=0, atol=0)
    for name, value in bank.with_auxiliary(dcnn).trunk.state_dict().items():
        torch.testing.assert_close(both.trunk.state_dict()[name], value, rtol=0, atol=0)


def test_what_cannot_stand_beside_is_refused() -> None:
    bank, dcnn = _pair()
    with pytest.raises(InputError, match="the auxiliary network of a 'filter-bank' is a 'dcnn'"):
        bank.with_auxiliary(bank)
    with pytest.raises(InputError, match="given 6 distances, next to filters given 4"):
        bank.with_auxiliary(DCnn(distances=3))
    with pytest.raises(InputError, match="takes no auxiliary network"):
        dcnn.with_auxiliary(bank)
    with pytest.raises(InputError, match="does not fit this 'camera-bank'"):
        CameraBank(groups=2, width=4, blocks=(1,)).with_auxiliary(dcnn)
    with pytest.raises(InputError, match="not out of a 'filter-bank' with an auxiliary D-CNN"):
        CameraBank.grown(bank.with_auxiliary(dcnn))


def test_filters_of_both_are_of_the_same_psfs() -> None:
    bank, dcnn = _pair()
    both = bank.with_auxiliary(dcnn)
    both.set_psfs(_blurs(2))
    torch.testing.assert_close(both.filters, local_filters(_blurs(2), 9, 2).flatten(0, 1).to(both.filters))
    assert both.dcnn is not None and torch.equal(both.dcnn.transfer, both.transfer)


def test_a_bank_with_more_blocks_and_wider_filters_starts_from_another() -> None:
    """With filters as wide it restores the same at first; a D-CNN, which knows one mask, stays behind."""
    bank, dcnn = _pair()
    photo = _photo(3, 1, 3, 72, 80)
    more = FilterBank.grown(bank, {"blocks": (2, 2), "colour_psfs": True}).eval()
    more.set_psfs(torch.diag_embed(_blurs(3).movedim(1, -1)).movedim((-2, -1), (1, 2)))
    with torch.no_grad():
        torch.testing.assert_close(more.unclamped(photo), bank.unclamped(photo), rtol=0, atol=2e-5)
    assert more.settings() == {**bank.settings(), "blocks": [2, 2], "colour_psfs": True}
    any_camera = CameraBank.grown(more)  # which has no PSFs of its own
    assert any_camera.settings() == {**bank.settings(), "blocks": [2, 2]}
    alone = FilterBank.grown(bank.with_auxiliary(dcnn), {"support": 11})
    assert alone.dcnn is None and alone.support == 11
    torch.testing.assert_close(alone.trunk.state_dict(), bank.trunk.state_dict())
    for settings in ({"width": 6}, {"blocks": (1,)}, {"distances": 0}, {"blur": 3}):
        with pytest.raises(InputError, match="does not fit"):
            FilterBank.grown(bank, settings)
    with pytest.raises(InputError, match="not out of a 'dcnn'"):
        FilterBank.grown(dcnn)
