"""Checkpoints come back as they were saved, and damaged or foreign ones are refused with a reason."""

from __future__ import annotations

import json
import os
import pickle
from pathlib import Path

import pytest
import torch
from safetensors.torch import save_file

from edofsim.errors import EdofsimError, InputError
from edofsim.recipe.camera import CameraRecipe
from edofsim.restore.checkpoint import camera_with_mask, load_checkpoint, read_once, save_checkpoint
from edofsim.restore.network import NETWORKS, build_network

CAMERA = CameraRecipe(name="paper")

SETTINGS = {"own": {"of": "torch.nn.modules.linear:Identity"}}
"""Of kinds that are not built without."""


def _card() -> dict:
    return {
        "name": "trial",
        "camera": CAMERA.model_dump(mode="json", exclude={"schema_"}),
        "seed": 7,
        "figures": {"psnr_db": 29.5},
    }


@pytest.mark.parametrize("kind", NETWORKS)
def test_what_was_saved_comes_back(kind: str, tmp_path: Path) -> None:
    network = build_network(kind, SETTINGS.get(kind)).eval()
    height = 1e-6 * torch.rand(9, 9)
    path = save_checkpoint(tmp_path / "a.safetensors", network, _card(), height=height, sampling=21e-6)
    loaded = load_checkpoint(path, CAMERA)
    photo = torch.rand(1, 3, 16, 16)
    with torch.no_grad():
        assert torch.equal(loaded.network(photo), network(photo))
    assert torch.equal(loaded.height, height)
    assert loaded.sampling == 21e-6
    assert (loaded.name, loaded.card["seed"], loaded.card["figures"]) == ("trial", 7, {"psnr_db": 29.5})


def test_a_file_is_read_once_until_it_or_the_camera_changes(tmp_path: Path) -> None:
    path = save_checkpoint(tmp_path / "a.safetensors", build_network("dcnn"), _card())
    first = read_once(path, CAMERA)
    assert read_once(path, CAMERA) is first
    quieter = CAMERA.model_copy(update={"sensor": CAMERA.sensor.model_copy(update={"read_noise": 0.001})})
    assert read_once(path, quieter) is not first
    save_checkpoint(path, build_network("dcnn"), {**_card(), "name": "again"})
    assert read_once(path, CAMERA).name == "again"
    with pytest.raises(InputError, match="aperture_radius_mm"):
        read_once(path, CameraRecipe(name="other", lens={"aperture_radius_mm": 3.0}))


def test_another_camera_is_refused_by_field(tmp_path: Path) -> None:
    path = save_checkpoint(tmp_path / "a.safetensors", build_network("dcnn"), _card())
    other = CameraRecipe(
        name="other", lens={"aperture_radius_mm": 3.0}, sensor={"pixel_um": 5.0, "read_noise": 0.01}
    )
    with pytest.raises(InputError) as caught:
        load_checkpoint(path, other)
    problems = caught.value.problems
    assert len(problems) == 2  # the read noise may differ
    assert any("lens.aperture_radius_mm = 2.5, this one has 3.0" in problem for problem in problems)
    assert any("sensor.pixel_um = 6.0, this one has 5.0" in problem for problem in problems)


@pytest.mark.parametrize("keep", [0, 7, 8, 200, 20_000, -1])
def test_a_truncated_file_is_refused(keep: int, tmp_path: Path) -> None:
    path = save_checkpoint(tmp_path / "a.safetensors", build_network("dcnn"), _card())
    path.write_bytes(path.read_bytes()[:keep])
    with pytest.raises(InputError, match="not a whole checkpoint"):
        load_checkpoint(path)


def test_a_pickle_is_not_opened(tmp_path: Path) -> None:
    class Trap:
        def __reduce__(self):
            return os.system, (f"touch {tmp_path / 'ran'}",)

    path = tmp_path / "evil.safetensors"
    path.write_bytes(pickle.dumps(Trap()))
    with pytest.raises(InputError, match="not a whole checkpoint"):
        load_checkpoint(path)
    torch.save({"network": Trap()}, path)
    with pytest.raises(InputError, match="not a whole checkpoint"):
        load_checkpoint(path)
    assert not (tmp_path / "ran").exists()


def _card_with(**network: object) -> dict[str, str]:
    return {"card": json.dumps({"format": 1, "network": network})}


@pytest.mark.parametrize(
    ("metadata", "message"),
    [
        (None, "no card"),
        ({"card": "{"}, "no card"),
        ({"card": "[1]"}, "no card"),
        (_card_with(kind="dcnn"), "no card"),
        (_card_with(kind="alexnet", settings={}), "unknown network 'alexnet'"),
        (_card_with(kind="dcnn", settings={"depth": 2}), "cannot be built"),
        (_card_with(kind="dcnn", settings={}), "do not fit"),
        ({"card": json.dumps({"format": 99, "network": {"kind": "dcnn", "settings": {}}})}, "update edofsim"),
    ],
)
def test_foreign_safetensors_are_refused(
    metadata: dict[str, str] | None, message: str, tmp_path: Path
) -> None:
    save_file({"a": torch.zeros(2)}, tmp_path / "b.safetensors", metadata=metadata)
    with pytest.raises(InputError, match=message):
        load_checkpoint(tmp_path / "b.safetensors")


def test_values_that_are_not_finite_are_neither_saved_nor_loaded(tmp_path: Path) -> None:
    network = build_network("dcnn")
    network.residual[0].bias.data[0] = torch.nan
    with pytest.raises(InputError, match="residual.0.bias"):
        save_checkpoint(tmp_path / "a.safetensors", network, _card())
    assert not list(tmp_path.iterdir())
    save_file({"network.a": torch.tensor([torch.inf])}, tmp_path / "b.safetensors", metadata=_card_with())
    with pytest.raises(InputError, match="not finite"):
        load_checkpoint(tmp_path / "b.safetensors")


def test_a_full_disk_leaves_the_old_checkpoint_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = save_checkpoint(tmp_path / "a.safetensors", build_network("dcnn"), _card())
    before = path.read_bytes()

    def full(handle: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(EdofsimError, match="the disk is full"):
        save_checkpoint(path, build_network("dcnn"), {**_card(), "seed": 8})
    assert path.read_bytes() == before
    assert [entry.name for entry in tmp_path.iterdir()] == ["a.safetensors"]


def test_a_missing_checkpoint_names_the_shipped_ones(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="shipped: "):
        load_checkpoint(tmp_path / "none.safetensors")


def test_a_camera_takes_the_mask_with_its_material_and_pitch(tmp_path: Path) -> None:
    """Given to a camera with a clear aperture, a height map keeps its own material and pitch."""
    trained = CameraRecipe(
        name="t", mask={"kind": "cubic", "design_wavelength_nm": 550.0, "material": "PMMA"}
    )
    card = {"name": "trial", "camera": trained.model_dump(mode="json", exclude={"schema_"})}
    path = tmp_path / "a.safetensors"
    save_checkpoint(path, build_network("dcnn"), card, height=torch.zeros(5, 5), sampling=21e-6)
    taken = camera_with_mask(CAMERA, load_checkpoint(path, CAMERA))
    camera = taken.recipe
    assert torch.equal(taken.height_map, torch.zeros(5, 5))
    assert (camera.name, camera.mask.kind, camera.mask.material) == ("paper", "height-map", "PMMA")
    assert camera.mask.pitch_um == pytest.approx(21.0)
    save_checkpoint(path, build_network("dcnn"), card)
    assert camera_with_mask(CAMERA, load_checkpoint(path)).recipe.mask == trained.mask
    save_checkpoint(path, build_network("dcnn"), {"name": "trial"})
    with pytest.raises(InputError, match="names no camera"):
        camera_with_mask(CAMERA, load_checkpoint(path))
