"""Pictures of rendered scenes as training data, on views made by hand: no renderer is needed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from edofsim.capture.photograph import capture
from edofsim.errors import InputError
from edofsim.learn import rendered
from edofsim.learn.photographs import PlaneSource
from edofsim.learn.reader import Wanted
from edofsim.learn.sources import Images
from edofsim.learn.training_camera import TrainingCamera
from edofsim.optics import Camera
from edofsim.recipe.camera import CameraRecipe
from edofsim.recipe.kinds import TRAINING_DATA
from edofsim.recipe.scene import SceneRecipe
from edofsim.recipe.train import TrainRecipe
from edofsim.render.view import View

CAMERA = Camera.from_recipe(CameraRecipe(name="c", mask={"kind": "height-map"}, psf={"window_px": 16}))
NOISY = 3


def _view(number: int) -> View:
    """A slope with a random picture; the fourth is noisy."""
    shape = (6, 40, 48)
    light = torch.rand(*shape, generator=torch.Generator().manual_seed(number)) * 10.0 ** (number - 2)
    light[:, 20, 20] = 1e4  # a lamp
    view = View.flat(
        light,
        torch.linspace(0, 2, 48).expand(40, 48),
        wavelengths=torch.linspace(420e-9, 720e-9, 6),
        pixel_angle=CAMERA.pixel_angle,
        margin=4,
    )
    return replace(view, noise=0.3 if number == NOISY else 0.01)


def _opened(monkeypatch: pytest.MonkeyPatch, **table: object) -> PlaneSource:
    source = {"kind": "rendered", "scenes": ["clutter"], "members": 5, **table}
    data = {"patch_px": 16, "validation": 0.25, "sources": [source]}
    recipe = TrainRecipe(name="r", camera="paper-clear", seed=3, data=data)
    wanted: list[SceneRecipe] = []

    def render(recipe: SceneRecipe, *_: object, **__: object) -> View:
        wanted.append(recipe)
        return _view(len(wanted) - 1)

    monkeypatch.setattr(rendered, "render", render)
    table = TRAINING_DATA["rendered"].model_validate(source)
    return table.open(Wanted(recipe, TrainingCamera(CAMERA, 16, torch.device("cpu")), Path(), None))


def test_views_are_pictures_as_sharp_and_as_bright_as_their_photos_show_them(monkeypatch: pytest.MonkeyPatch):
    """All but a noisy one, with their margins; what is far beyond full scale is cut."""
    source = _opened(monkeypatch)
    assert [len(images.pictures) for images in (source.training, source.held_back)] == [3, 1]
    assert source.described["left_out"] == [f"clutter-{1000 + NOISY}"] and source.described["members"] == 5
    pictures = [*source.training.pictures, *source.held_back.pictures]
    for number in (0, 1, 2, 4):
        ideal = capture(_view(number), CAMERA).ideal.clamp_max(rendered.BRIGHTEST)
        assert any(torch.allclose(each[:, 4:-4, 4:-4], ideal, atol=1e-5) for each in pictures)
    assert all(each.shape == (3, 40, 48) and each.max() == rendered.BRIGHTEST for each in pictures)


def test_each_is_a_plane_at_one_depth_of_the_range(monkeypatch: pytest.MonkeyPatch):
    source = _opened(monkeypatch, broadband=1.0, inverse_depth_per_m=[0.9, 1.1])
    scenes = source.draw(3, torch.Generator().manual_seed(1))
    assert scenes.broadband and scenes.sharp.shape == (3, 3, 31, 31)
    assert ((scenes.inverse_depths >= 0.9) & (scenes.inverse_depths <= 1.1)).all()
    assert torch.allclose(scenes.mean.mean(1), scenes.sharp.mean((1, 2, 3)), rtol=0.5)


def test_scenes_that_hold_no_patch_and_too_few_pictures_are_refused(monkeypatch: pytest.MonkeyPatch):
    with pytest.raises(InputError, match="one picture cannot be split"):
        _opened(monkeypatch, members=1)
    with pytest.raises(InputError, match="no-such-scene"):
        _opened(monkeypatch, scenes=["no-such-scene"])
    with pytest.raises(InputError, match="5 of 5 views have more noise .* 0.001 .* more samples"):
        _opened(monkeypatch, most_noise=0.001)


def test_means_of_pictures_are_of_full_scale_whatever_holds_them():
    picture = torch.full((3, 4, 4), 51, dtype=torch.uint8)
    images = Images((picture, picture / 255), ("bytes", "numbers"), "")
    assert torch.allclose(images.means, torch.full((2, 3), 0.2))
