"""Banks that are kept, and those that must not be."""

from __future__ import annotations

import pytest
import torch

from edofsim.optics import Camera, psf_bank
from edofsim.optics import cache as store
from edofsim.recipe.camera import CameraRecipe

GREEN = 543e-9


@pytest.fixture(autouse=True)
def empty_memory():
    store.forget()
    yield
    store.forget()


def camera(**recipe) -> Camera:
    return Camera.from_recipe(CameraRecipe(name="kept", psf={"window_px": 16}, **recipe))


def test_the_same_request_is_computed_once():
    first = psf_bank(camera(), [GREEN], [0.5]).values
    assert psf_bank(camera(), [GREEN], [0.5]).values is first
    assert psf_bank(camera(), [GREEN], [0.5], window_px=17).values is not first
    assert psf_bank(camera(), [GREEN], [0.6]).values is not first
    assert psf_bank(camera(), [544e-9], [0.5]).values is not first
    assert psf_bank(camera(), [GREEN], [0.5], dtype=torch.float64).values is not first
    assert psf_bank(camera(mask={"kind": "cubic"}), [GREEN], [0.5]).values is not first
    assert psf_bank(camera(lens={"surface_profile": "parabolic"}), [GREEN], [0.5]).values is not first
    assert psf_bank(camera(sensor={"pixel_um": 5.0}), [GREEN], [0.5]).values is not first


def test_what_does_not_change_psfs_does_not_change_the_key():
    first = psf_bank(camera(), [GREEN], [0.5]).values
    assert psf_bank(camera(sensor={"read_noise": 0.1}, purpose="other"), [GREEN], [0.5]).values is first


def test_trainable_heights_are_never_kept():
    height = torch.zeros(40, 40, requires_grad=True)
    first = psf_bank(camera().with_height(height), [GREEN], [0.5])
    second = psf_bank(camera().with_height(height), [GREEN], [0.5])
    assert first.values.requires_grad and first.values is not second.values
    with torch.no_grad():
        height += 1e-7 * torch.rand(40, 40)
    assert not torch.equal(psf_bank(camera().with_height(height), [GREEN], [0.5]).values, first.values)
    with pytest.raises(ValueError, match="gradients"):
        store.keep("key", first.values, None)


def test_fixed_heights_are_kept_by_content():
    height = torch.zeros(40, 40)
    first = psf_bank(camera().with_height(height), [GREEN], [0.5]).values
    assert psf_bank(camera().with_height(height.clone()), [GREEN], [0.5]).values is first
    height[20, 20] = 1e-7
    assert psf_bank(camera().with_height(height), [GREEN], [0.5]).values is not first


def test_a_changed_file_is_read_again(tmp_path):
    import numpy as np

    recipe = CameraRecipe(name="map", mask={"kind": "height-map", "file": "m.npy", "pitch_um": 100.0})
    seen = Camera.from_recipe(recipe, tmp_path)
    np.save(tmp_path / "m.npy", np.zeros((50, 50)))
    first = psf_bank(seen, [GREEN], [0.5], window_px=8)
    np.save(tmp_path / "m.npy", np.random.default_rng(0).random((50, 50)) * 1e-7)
    assert not torch.equal(psf_bank(seen, [GREEN], [0.5], window_px=8).values, first.values)


def test_banks_on_disk_outlive_the_memory_and_damage_is_computed_again(tmp_path):
    first = psf_bank(camera(), [GREEN], [0.5, 1.0], cache=tmp_path)
    (file,) = tmp_path.glob("*.safetensors")
    store.forget()
    again = psf_bank(camera(), [GREEN], [0.5, 1.0], cache=tmp_path)
    assert torch.equal(again.values, first.values) and torch.equal(again.truncated, first.truncated)
    store.forget()
    file.write_bytes(file.read_bytes()[:100])
    assert torch.equal(psf_bank(camera(), [GREEN], [0.5, 1.0], cache=tmp_path).values, first.values)


def test_a_folder_that_cannot_be_written_is_done_without(tmp_path, caplog):
    (tmp_path / "file").touch()
    first = psf_bank(camera(), [GREEN], [0.5], cache=tmp_path / "file")
    assert "not kept" in caplog.text and [path.name for path in tmp_path.iterdir()] == ["file"]
    store.forget()
    assert torch.equal(psf_bank(camera(), [GREEN], [0.5]).values, first.values)


def test_mixed_precision_around_it_changes_no_bit():
    """Nor what is remembered for those who ask without it; trained reliefs neither."""
    height = torch.zeros(40, 40, requires_grad=True)
    with torch.autocast("cpu", torch.bfloat16):
        mixed = psf_bank(camera(), [GREEN], [0.5]).values
        trained = psf_bank(camera().with_height(height), [GREEN], [0.5]).values
    store.forget()
    assert torch.equal(psf_bank(camera(), [GREEN], [0.5]).values, mixed)
    assert torch.equal(psf_bank(camera().with_height(height), [GREEN], [0.5]).values, trained)


def test_memory_has_a_limit(monkeypatch):
    monkeypatch.setattr(store.BANKS, "memory_bytes", 3000)  # two banks of 16 x 16 float32, not three
    banks = [psf_bank(camera(), [GREEN], [depth]).values for depth in (0.1, 0.2, 0.3)]
    assert psf_bank(camera(), [GREEN], [0.3]).values is banks[2]
    assert psf_bank(camera(), [GREEN], [0.1]).values is not banks[0]


def test_threads_are_given_back():
    torch.set_num_threads(2)
    psf_bank(camera(), [GREEN, 600e-9, 650e-9], [0.5, 1.0])
    assert torch.get_num_threads() == 2


def test_number_of_threads_does_not_change_a_bit():
    before = torch.get_num_threads()
    banks = []
    for threads in (1, 3):
        torch.set_num_threads(threads)
        store.forget()
        banks.append(psf_bank(camera(), [GREEN], [0.1, 0.5, 0.9, 1.5]).values)
    torch.set_num_threads(before)
    assert torch.equal(*banks)
