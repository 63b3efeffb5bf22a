"""Small folders, cubes and systems for the paper's experiments."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image
from skimage import data as pictures
from torch import Tensor

from edofsim.experiments import broadband, chromatic, cubes, photographs, planes, robustness
from edofsim.experiments.systems import EvaluatedSystem
from edofsim.optics import Camera
from edofsim.recipe.camera import CameraRecipe
from edofsim.recipe.fabrication import Fabrication
from edofsim.restore.checkpoint import save_checkpoint
from edofsim.restore.network import build_network

PSF = {"window_px": 24, "oversampling": 2, "pupil_sampling_um": 15.0}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Three photographs."""
    place = tmp_path / "data"
    place.mkdir()
    Image.fromarray(pictures.astronaut()[100:196, 150:262]).save(place / "a.png")
    Image.fromarray(pictures.coffee()[100:180, 200:300]).save(place / "b.png")
    Image.fromarray(pictures.chelsea()[50:130, 100:200]).save(place / "c.png")
    return place


@pytest.fixture
def broken(folder: Path) -> Path:
    """The same folder; the second of its photographs is cut short."""
    whole = (folder / "b.png").read_bytes()
    (folder / "b.png").write_bytes(whole[: len(whole) // 3])
    return folder


@pytest.fixture
def coarse(monkeypatch: pytest.MonkeyPatch) -> None:
    """Small windows and masks that are made coarsely: the experiments' steps, not their cost."""

    def made(camera: Camera, fabrication: Fabrication) -> Camera:
        update = {"psf": CameraRecipe(name="c", psf=PSF).psf}
        if hasattr(camera.recipe.mask, "design_wavelength_nm"):
            update["fabrication"] = fabrication.model_copy(update={"pitch_um": 12.0})
        return replace(camera, recipe=camera.recipe.model_copy(update=update))

    for module in (planes, broadband):
        monkeypatch.setattr(module, "made", made)
    monkeypatch.setattr(photographs, "CHART_PX", 160)
    monkeypatch.setattr(photographs, "SMALLEST_PX", 64)
    monkeypatch.setattr(chromatic, "MAP_DEPTHS", 5)
    monkeypatch.setattr(chromatic, "BANDS_M", torch.tensor([450, 550, 650], dtype=torch.float64) * 1e-9)


@pytest.fixture
def echo() -> Callable[..., EvaluatedSystem]:
    """A system that gives its photo back."""

    def build(
        mask: str = "clear", restore: Callable[[Tensor, Tensor], Tensor] = lambda photo, glare: photo
    ) -> EvaluatedSystem:
        recipe = CameraRecipe(name="c", mask={"kind": mask}, psf=PSF)
        return EvaluatedSystem("echo", Camera.from_recipe(recipe), restore, "echo" + mask)

    return build


@pytest.fixture
def network(tmp_path: Path) -> Path:
    """An untrained network with a flat mask."""
    camera = CameraRecipe(name="c", mask={"kind": "height-map"}, psf=PSF)
    card = {"name": "trained", "camera": camera.model_dump(mode="json", exclude={"schema_"})}
    untrained = build_network("local-unet", {"width": 4, "blocks": [1, 1]})
    path = tmp_path / "net.safetensors"
    save_checkpoint(path, untrained, card, height=torch.zeros(239, 239), sampling=21e-6)
    return path


@pytest.fixture
def only(monkeypatch: pytest.MonkeyPatch) -> Callable[[EvaluatedSystem], None]:
    """Evaluate one system, whatever is asked for."""

    def put(system: EvaluatedSystem) -> None:
        monkeypatch.setattr(robustness, "evaluated_systems", lambda names: [system])

    return put


@pytest.fixture
def cave(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A cube as CAVE's are, but small: 31 pictures of 16 bits, 400 to 700 nm; a warm grey with texture."""
    monkeypatch.setattr(cubes, "SMALLEST_PX", 64)
    monkeypatch.setattr(cubes, "REACH_PX", 12)
    place = tmp_path / "cubes" / "toy_ms"
    place.mkdir(parents=True)
    texture = pictures.coffee()[100:180, 200:296, 1] / 255
    for band in range(31):
        level = 0.2 + 0.6 * band / 30
        values = np.round(65535 * level * texture).astype(np.uint16)
        Image.fromarray(values).save(place / f"toy_ms_{band + 1:02d}.png")
    return place
