"""`edofsim run` in this process."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from torch import Tensor

from edofsim import pipeline
from edofsim.optics import Camera

SCENE = """
name = "card"
frame = { width_px = 96, height_px = 80, margin_px = 32 }
bands = { count = 3 }
render = { samples = 2, max_depth = 2 }
lights = [{ kind = "sky" }]
objects = [{ kind = "wall", depth_m = 2.0 }]
"""


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
    effects = left_out or ("--with", "spherical aberration")
    status, said = edofsim("run", tmp_path / "card.toml", "--camera", "paper-cubic", *effects, *where)
    assert status == 0, said
    (camera,) = told
    assert camera.lens.aberrates == (not left_out)
