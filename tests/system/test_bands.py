"""Few groups of bands leave the colours as they are."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import pytest
import torch
from torch import Tensor

from edofsim.capture import Fidelity, capture
from edofsim.core.images import read_exr
from edofsim.optics import Camera
from edofsim.recipe import load_camera
from edofsim.render.view import View
from edofsim.report.run_page import _focused, refocused

SCENE = """
name = "cards"
frame = { width_px = 48, height_px = 32, margin_px = 24 }
bands = { count = 31 }
render = { samples = 4, max_depth = 2 }
lights = [{ kind = "sky" }]

[[objects]]
kind = "panel"
x_mm = -60
width_mm = 120
height_mm = 200
depth_m = 1.0
surface = { kind = "matt", reflectance = "COLOUR" }

[[objects]]
kind = "wall"
depth_m = 2.0
surface = { kind = "matt", reflectance = "COLOUR" }
"""


def means(path: Path) -> Tensor:
    """Of the channels of the photo without noise."""
    channels = read_exr(path, "photo")
    return torch.tensor([float(channels[f"clean.{name}"].mean()) for name in "RGB"])


@pytest.mark.parametrize(
    "colour", ["red", *(pytest.param(name, marks=pytest.mark.slow) for name in ("blue", "yellow"))]
)
def test_bands_in_few_groups_keep_the_light_of_each_channel(
    tmp_path: Path, edofsim: Callable[..., tuple[int, str]], colour: str
):
    """Sums over bands weighted by the response, in whatever groups, are the same sums: the blur alone may
    move light over the border. Bands that were merged made red of 0.255, 0.122, 0.107 0.195, 0.172, 0.112."""
    (tmp_path / "cards.toml").write_text(SCENE.replace("COLOUR", colour))
    cubic = load_camera("paper-cubic").text.replace("window_px = 128", "window_px = 48")
    (tmp_path / "cubic.toml").write_text(cubic)
    found = {}
    for groups in ("1", "3", "31"):
        where = ("--out", tmp_path / groups, "--cache", tmp_path / "views", "--quiet")
        status, said = edofsim(
            "expose", tmp_path / "cards.toml", "--bands", groups, "--camera", tmp_path / "cubic.toml", *where
        )
        assert status == 0, said
        found[groups] = means(tmp_path / groups / "photo.exr")
    assert float(found["31"].max() / found["31"].min()) > 1.5  # it is a colour
    for groups in ("1", "3"):
        assert torch.allclose(found[groups], found["31"], rtol=0.005)


def test_the_slider_over_depth_shows_the_colours_of_the_photo():
    """Wherever the lens is focused, its light in each channel is that of every band and many layers."""
    camera = Camera.from_recipe(load_camera("paper-cubic").recipe, Path())
    rgb = torch.tensor([0.8, 0.2, 0.15])[None, None].expand(40, 64, 3).numpy()
    depth = torch.ones(40, 64)
    depth[:, :32] = 2.0
    view = View.from_image(rgb, depth.numpy(), pixel_angle=camera.pixel_angle)
    taken = SimpleNamespace(view=view, optics=camera, photo=SimpleNamespace(exposure=1.0))
    pictures = _focused(taken)
    assert len(pictures) > 1
    for metres, picture in pictures.items():
        lens = refocused(camera.without_mask(), metres)
        truth = capture(view, lens, Fidelity(occlusion="normalised"), exposure=1.0).clean
        assert torch.allclose(picture.mean((1, 2)), truth.mean((1, 2)), rtol=0.005)
