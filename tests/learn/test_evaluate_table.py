"""The paper's table on two small pictures: the same for a seed, judged as the protocol says."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image
from skimage import data as pictures

from edofsim.errors import InputError
from edofsim.evaluate import table
from edofsim.optics import Camera
from edofsim.recipe.camera import CameraRecipe
from edofsim.restore.checkpoint import save_checkpoint
from edofsim.restore.network import build_network

PSF = {"window_px": 24, "oversampling": 2, "pupil_sampling_um": 21.0}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "data").mkdir()
    Image.fromarray(pictures.astronaut()[100:196, 150:262]).save(tmp_path / "data/a.png")
    Image.fromarray(pictures.coffee()[100:180, 200:300]).save(tmp_path / "data/b.png")
    return tmp_path / "data"


@pytest.fixture(autouse=True)
def _coarse(monkeypatch: pytest.MonkeyPatch) -> None:
    """Small windows and no 3 um mask: the protocol's steps, not its cost."""
    monkeypatch.setattr(
        table, "made", lambda recipe, seed: Camera.from_recipe(recipe.model_copy(update={"psf": _psf()}))
    )


def _psf() -> object:
    return CameraRecipe(name="c", psf=PSF).psf


def _echo(camera: CameraRecipe) -> table.Contestant:
    """A system that gives its photo back."""
    return table.Contestant("echo", table.made(camera, 0), None, lambda photo: photo)


def test_a_photo_given_back_scores_as_the_photo(folder: Path) -> None:
    images = table.read_folder(folder, 64)
    rows = table.judge(_echo(CameraRecipe(name="clear")), images, seed=3)
    assert [row.depth for row in rows] == ["random"] * 2 + ["0.5m"] * 2 + ["0.8m"] * 2 + ["1m"] * 2
    assert all(row.restored_db == row.photo_db for row in rows)
    assert all(0 <= row.inverse_depth <= 2 for row in rows)
    # a clear aperture focused at 1.5 m blurs more the nearer the plane
    figures = table.averages(rows)
    assert figures["psnr_db.echo.0.5m"] < figures["psnr_db.echo.0.8m"] < figures["psnr_db.echo.1m"]


def test_the_photo_is_the_papers_model(folder: Path) -> None:
    """Written out once more: convolution of the mirrored picture, noise of 0.005."""
    images = table.read_folder(folder, 64)
    camera = CameraRecipe(name="clear")
    row = table.judge(_echo(camera), images, seed=0)[2]  # the first picture at 0.5 m
    psf = table.psf_bank(table.made(camera, 0), table.COLOURS, [2.0]).values[0]
    sharp = images.pictures[0].to(torch.float32) / 255
    reach = 24
    mirrored = torch.from_numpy(np.pad(sharp.numpy(), ((0, 0), (reach, reach), (reach, reach)), "symmetric"))
    blurred = torch.nn.functional.conv2d(mirrored[None], psf.flip(-2, -1)[:, None], groups=3)[0]
    start = reach - (24 - 1 - 24 // 2)
    blurred = blurred[:, start : start + sharp.shape[1], start : start + sharp.shape[2]]
    expected = -10 * math.log10(float((blurred - sharp).square().mean()) + 0.005**2)
    assert row.photo_db == pytest.approx(expected, abs=0.02)


def test_the_table_is_written_and_repeats(folder: Path, tmp_path: Path) -> None:
    camera = CameraRecipe(name="c", mask={"kind": "height-map"}, psf=PSF)
    card = {"name": "trained", "camera": camera.model_dump(mode="json", exclude={"schema_"})}
    network = build_network("local-unet", {"width": 4, "blocks": [1, 1]})
    path = tmp_path / "net.safetensors"
    save_checkpoint(path, network, card, height=torch.zeros(239, 239), sampling=21e-6)
    systems = [path, "paper-cubic"]
    figures = table.run(tmp_path / "out", folder, systems=systems)
    assert figures == table.run(tmp_path / "again", folder, systems=systems)
    rows = list(csv.DictReader((tmp_path / "out/table.csv").open()))
    assert len(rows) == 2 * 2 * 4
    mean = np.mean(
        [float(row["restored_db"]) for row in rows if (row["system"], row["depth"]) == ("trained", "1m")]
    )
    assert figures["psnr_db.trained.1m"] == pytest.approx(mean, abs=1e-3)
    # all systems see a picture at the same random depth
    depths = {(row["picture"], row["inverse_depth_per_m"]) for row in rows if row["depth"] == "random"}
    assert len(depths) == 2
    # cubic blur is removed by its filter
    assert figures["psnr_db.paper-cubic+wiener.1m"] > figures["psnr_db.paper-cubic+wiener.photo.1m"] + 1


def test_what_cannot_be_judged_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such folder"):
        table.run(tmp_path / "out", tmp_path / "none", systems=["paper-clear"])
    with pytest.raises(InputError, match="no such checkpoint"):
        table.contestant("nobody", 0)
