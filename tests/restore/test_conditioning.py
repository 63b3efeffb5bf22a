"""A bank of filters that is told the sensor's response, against photos through every band's own PSF."""

from __future__ import annotations

import copy
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from torch import Tensor

from edofsim.errors import InputError
from edofsim.learn.trainer import train
from edofsim.optics import PAPER_COLOURS, Camera, psf_bank, response
from edofsim.recipe.load import Loaded
from edofsim.recipe.scene import Bands
from edofsim.recipe.train import TrainRecipe
from edofsim.restore import kept_state
from edofsim.restore.checkpoint import Checkpoint, camera_with_mask, load_checkpoint, trained_camera
from edofsim.restore.conditioning import conditioned_on, forget
from edofsim.restore.dcnn import DCnn
from edofsim.restore.network import apply_network
from edofsim.restore.photograph_statistics import power_spectrum
from edofsim.restore.restore import restore

SMALL = {"groups": 3, "distances": 2, "support": 13, "width": 4, "blocks": [1, 1]}
BANDS = torch.from_numpy(Bands().wavelengths())


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Checkpoint:
    """The lens alone as a flat relief, out of focus, a bank told its three wavelengths, hardly trained."""
    recipe = TrainRecipe.model_validate(
        {
            "name": "bank",
            "camera": "paper-clear",
            "seed": 1,
            "mask": {"kind": "height-map"},
            "psf": {"window_px": 32, "pupil_sampling_um": 21.0},
            "capture": {"inverse_depth_per_m": [1.1, 1.4]},
            "network": {"kind": "filter-bank", "settings": SMALL},
            "doe": {"height_noise_nm": 0.0, "learning_rate_rad": 0.0},
            "data": {"patch_px": 64, "validation_patches": 4, "sources": [{"kind": "packaged"}]},
            "optimiser": {"steps": 1, "batch": 4, "learning_rate": 1e-9},
        }
    )
    folder = tmp_path_factory.mktemp("bank")
    return load_checkpoint(train(Loaded(recipe, Path("bank.toml"), ""), folder).checkpoint)


def _camera(checkpoint: Checkpoint, sensor: str = "paper") -> Camera:
    recipe = trained_camera(checkpoint)
    response_of = recipe.sensor.model_copy(update={"response": sensor})
    psf = recipe.psf.model_copy(update={"pupil_sampling_um": "auto"})
    return camera_with_mask(recipe.model_copy(update={"sensor": response_of, "psf": psf}), checkpoint)


def _texture() -> Tensor:
    """Grey, with the spectrum of photographs, [y, x]."""
    noise = torch.randn(256, 256, generator=torch.Generator().manual_seed(3), dtype=torch.float64)
    drawn = torch.fft.irfft2(torch.fft.rfft2(noise) * power_spectrum(256, noise).sqrt(), s=(256, 256))
    return (drawn - drawn.mean()) / drawn.std() * 0.12 + 0.5


def _photographed(texture: Tensor, psf: Tensor) -> Tensor:
    """A periodic texture through PSFs [3, w, w], [3, y, x]."""
    size, w = texture.shape[-1], psf.shape[-1]
    padded = torch.nn.functional.pad(psf, (0, size - w, 0, size - w)).roll((-(w // 2),) * 2, (-2, -1))
    return torch.fft.irfft2(torch.fft.rfft2(texture) * torch.fft.rfft2(padded), s=(size, size))


def test_told_the_response_it_restores_many_bands_better(trained: Checkpoint) -> None:
    camera, texture = _camera(trained), _texture()
    bands = psf_bank(camera, BANDS, [1.25], window_px=64, dtype=torch.float64)
    photo = _photographed(texture, (response(camera, BANDS)[:, :, None, None] * bands.values[0]).sum(1))
    photo = (photo + 0.003 * torch.randn(photo.shape, generator=torch.Generator().manual_seed(4))).float()

    def error(image: Tensor) -> float:
        return float((image.double() - texture)[:, 40:-40, 40:-40].square().mean().log10() * 10)

    told, _ = restore(photo, camera, BANDS, torch.tensor([1.25]), checkpoint=trained)
    untold = apply_network(trained.network, photo)
    assert error(told) < error(untold) - 0.3
    assert error(untold) < error(photo)


def test_what_it_is_told_for_three_lines_is_what_it_learned_with(trained: Checkpoint) -> None:
    """With a response of three wavelengths, written as a table, it is told what its training told it."""
    camera = _camera(trained)
    table = torch.eye(3, dtype=torch.float64)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("edofsim.restore.conditioning.response", lambda *_: table)
        told = conditioned_on(trained, camera, PAPER_COLOURS)
    own = trained.network
    assert told is not own
    scale = float(own.filters.abs().max())  # the pupil is sampled more finely than in the training
    torch.testing.assert_close(told.filters, own.filters, atol=1e-2 * scale, rtol=0)
    torch.testing.assert_close(told.transfer, own.transfer, atol=1e-2, rtol=0)
    weights, others = dict(told.named_parameters()), dict(own.named_parameters())
    assert all(torch.equal(weights[name], others[name]) for name in others)


def test_three_lines_and_other_networks_are_left_as_they_are(trained: Checkpoint) -> None:
    lines = PAPER_COLOURS.sort().values
    assert conditioned_on(trained, _camera(trained, "lines"), lines) is trained.network
    assert conditioned_on(trained, _camera(trained, "lines"), BANDS) is trained.network  # none to be told
    plain = replace(trained, network=DCnn())
    assert conditioned_on(plain, _camera(trained), BANDS) is plain.network


def test_it_is_told_once(trained: Checkpoint) -> None:
    camera = _camera(trained)
    first = conditioned_on(trained, camera, BANDS)
    assert conditioned_on(trained, camera, BANDS) is first
    fewer = BANDS[::2]
    assert conditioned_on(trained, camera, fewer) is not first


def test_the_next_process_is_told_what_is_kept(
    trained: Checkpoint, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without solving for filters again, to the last bit; a damaged file counts as none."""
    monkeypatch.setattr(kept_state, "user_folder", lambda: tmp_path)
    camera, photo = _camera(trained), torch.rand(1, 3, 48, 64, generator=torch.Generator().manual_seed(0))

    def restored(**change: object) -> Tensor:
        forget()  # as a process begins
        return conditioned_on(replace(trained, **change), camera, BANDS)(photo)

    with torch.no_grad():
        first = restored()
        (file,) = (tmp_path / "filters").iterdir()
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(type(trained.network), "set_psfs", None)
            assert torch.equal(restored(), first)
        file.write_bytes(file.read_bytes()[:1000])
        assert torch.equal(restored(), first) and file.stat().st_size > 1000
        other = copy.deepcopy(trained.network)
        next(other.parameters()).add_(1e-3)
        assert not torch.equal(restored(network=other), first)
        assert not torch.equal(restored(height=2 * trained.height), first)
    assert len(list((tmp_path / "filters").iterdir())) == 3


def test_a_state_that_is_more_than_tensors_is_not_kept(
    trained: Checkpoint, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It would come back without the rest: a network of another package may count what it was given."""
    monkeypatch.setattr(kept_state, "user_folder", lambda: tmp_path)
    given, kind = iter(range(9)), type(trained.network)
    own = kind.psf_state
    monkeypatch.setattr(kind, "psf_state", lambda self: (own(self), next(given)))
    forget()
    conditioned_on(trained, _camera(trained), BANDS)
    assert not (tmp_path / "filters").exists()


def test_bands_that_the_sensor_does_not_know_are_refused(trained: Checkpoint) -> None:
    with pytest.raises(InputError, match="covers"):
        conditioned_on(trained, _camera(trained), torch.tensor([300e-9, 500e-9]))


def test_a_card_without_its_recipe_is_refused_where_a_bank_needs_it(trained: Checkpoint) -> None:
    card = {name: value for name, value in trained.card.items() if name != "recipe"}
    with pytest.raises(InputError, match="names no recipe"):
        conditioned_on(
            replace(trained, network=copy.deepcopy(trained.network), card=card), _camera(trained), BANDS
        )
