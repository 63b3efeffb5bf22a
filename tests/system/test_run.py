"""`edofsim run` in this process."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest
import torch
from torch import Tensor, nn

import edofsim as package
from edofsim import pipeline
from edofsim.learn import fit
from edofsim.optics import Camera

SCENE = """
name = "card"
frame = { width_px = 96, height_px = 80, margin_px = 32 }
bands = { count = 3 }
render = { samples = 2, max_depth = 2 }
lights = [{ kind = "sky" }]
objects = [{ kind = "wall", depth_m = 2.0 }]
"""


@pytest.mark.usefixtures("plots_left_out")
@pytest.mark.parametrize("left_out", [(), ("--without", "spherical aberration")])
def test_wiener_deconvolution_is_told_the_camera_as_the_plan_simulates_it(
    tmp_path: Path,
    edofsim: Callable[..., tuple[int, str]],
    monkeypatch: pytest.MonkeyPatch,
    left_out: tuple[str, ...],
):
    """Whose lens has no aberration where the plan leaves it out, and only there."""
    (tmp_path / "card.toml").write_text(SCENE)
    told: list[Camera] = []
    inner = pipeline.channel_psfs

    def noted(camera: Camera, wavelengths: Tensor, depths: Tensor) -> Tensor:
        told.append(camera)
        return inner(camera, wavelengths, depths)

    monkeypatch.setattr(pipeline, "channel_psfs", noted)
    where = ("--out", tmp_path / "out", "--cache", tmp_path / "views", "--quiet")
    effects, network = left_out or ("--with", "spherical aberration"), ("--network", "wiener")
    status, said = edofsim(
        "run", tmp_path / "card.toml", "--camera", "paper-cubic", *network, *effects, *where
    )
    assert status == 0, said
    (camera,) = told
    assert camera.lens.aberrates == (not left_out)


class Sharper(nn.Module):
    """A network that knows nothing of this package."""

    def __init__(self, width: int = 4) -> None:
        super().__init__()
        self.width, self.first = width, nn.Conv2d(3, width, 3, padding=1)
        self.last = nn.Conv2d(width, 3, 3, padding=1)

    def forward(self, photo: Tensor) -> Tensor:
        return photo + 0.1 * self.last(self.first(photo).relu())


class Ring(nn.Module):
    """A relief, and the dark middle of an annular aperture."""

    def __init__(self) -> None:
        super().__init__()
        self.strength = nn.Parameter(torch.tensor(0.5))

    def forward(self) -> dict[str, Tensor]:
        across = torch.linspace(-1, 1, 40)
        amplitude = (across**2 + across[:, None] ** 2).clamp(0.1, 1)
        return {"height": self.strength * 1e-6 * amplitude, "amplitude": amplitude}


def test_a_network_and_a_mask_of_ones_own_take_and_restore_a_scene(
    tmp_path: Path, edofsim: Callable[..., tuple[int, str]]
):
    """What `learn.fit` saved is one system: `run` takes the photo by its mask, its network restores it."""
    (tmp_path / "card.toml").write_text(SCENE)
    how = {"steps": 1, "batch": 1, "patch_px": 32, "device": "cpu", "out": tmp_path / "hers"}
    done = fit(package.camera(window=32), Sharper(), mask=Ring(), **how)
    where = ("--out", tmp_path / "out", "--cache", tmp_path / "views", "--quiet")
    numbers = tmp_path / "run.json"
    status, said = edofsim(
        "run", tmp_path / "card.toml", "--network", done.checkpoint, "--json", numbers, *where
    )
    assert status == 0, said
    assert json.loads(numbers.read_text())["figures"]["psnr_db.restored"] > 10
