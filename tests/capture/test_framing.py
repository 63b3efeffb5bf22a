"""A scene serves every camera: its pixels are the camera's unless its recipe says otherwise."""

from __future__ import annotations

import pytest

from edofsim.capture.framing import framed
from edofsim.errors import InputError
from edofsim.optics import Camera
from edofsim.recipe import load_camera
from edofsim.recipe.camera import CameraRecipe
from edofsim.recipe.scene import SceneRecipe
from edofsim.render import view_key
from edofsim.render.settings import RenderSettings


def scene(**frame) -> SceneRecipe:
    card = {"kind": "panel", "depth_m": 1.0, "width_mm": 10, "height_mm": 10}
    data = {"name": "a", "objects": [card], "lights": [{"kind": "sky"}], "frame": frame}
    return SceneRecipe.model_validate(data)


def camera(**sensor) -> Camera:
    return Camera.from_recipe(CameraRecipe.model_validate({"name": "own", "sensor": sensor}))


@pytest.mark.parametrize("frame", [{}, {"pixel_angle_mrad": "auto"}])
def test_a_scene_follows_the_camera(frame: dict):
    """One pixel sees its width over the distance of the sensor."""
    own = camera(pixel_um=3.45)
    settings = RenderSettings.from_recipe(framed(scene(**frame), own))
    assert settings.pixel_angle == pytest.approx(3.45e-6 / own.sensor_distance, rel=1e-6)
    assert framed(framed(scene(**frame), own), own) == framed(scene(**frame), own)


def test_views_of_the_papers_camera_stay_where_they_are(tmp_path):
    paper = Camera.from_recipe(load_camera("paper-cubic").recipe)
    assert view_key(framed(scene(), paper), tmp_path) == view_key(scene(), tmp_path)


def test_another_angle_is_refused_before_anything_is_rendered():
    with pytest.raises(InputError, match='sees 0.2 mrad and one of the camera own 0.162613 mrad.*"auto"'):
        framed(scene(pixel_angle_mrad=0.2), camera())
    assert framed(scene(pixel_angle_mrad=0.1626), camera()).frame.pixel_angle_mrad == 0.1626


def test_without_a_camera_there_is_nothing_to_follow():
    with pytest.raises(InputError, match="follows a camera, and there is none here"):
        RenderSettings.from_recipe(scene(pixel_angle_mrad="auto"))
