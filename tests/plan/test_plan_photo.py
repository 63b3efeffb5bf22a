"""The plan asks for what a view and a camera call for, and for nothing else."""

from __future__ import annotations

import pytest
import torch

from edofsim.optics import Camera
from edofsim.plan import plan_photo, thumbnail
from edofsim.recipe import CameraRecipe, load_scene
from edofsim.recipe.camera import Lens, Sensor
from edofsim.render.view import View

CAMERA = Camera.from_recipe(CameraRecipe(name="test"))


def flat(inverse_depth: torch.Tensor, hidden: tuple[int, ...] = ()) -> View:
    """A view with one fragment a pixel at the given depths [y, x], and hidden ones at infinity behind some."""
    rows, columns = inverse_depth.shape
    behind = torch.tensor(hidden, dtype=torch.int64)
    pixel = torch.cat([torch.arange(rows * columns), behind])
    depth = torch.cat([inverse_depth.flatten(), torch.zeros(len(hidden))])
    order = torch.sort(pixel, stable=True).indices
    return View(
        height=rows,
        width=columns,
        margin=0,
        pixel=pixel[order],
        coverage=torch.ones(len(pixel)),
        inverse_depth=depth[order],
        radiance=torch.ones(2, len(pixel)),
        hidden=(torch.arange(len(pixel)) >= rows * columns)[order],
        wavelengths=torch.tensor([500e-9, 600e-9], dtype=torch.float64),
        pixel_angle=CAMERA.pixel_angle,
    )


def decision(view: View, effect: str, camera: Camera = CAMERA):
    (found,) = [d for d in plan_photo(view, camera).decisions if d.effect == effect]
    return found


def test_one_depth_calls_for_one_layer_and_no_occlusion():
    plan = plan_photo(flat(torch.full((6, 8), 0.7)), CAMERA)
    assert plan.settings["layers"] == 1 and plan.settings["occlusion"] == "none"
    called_for = {d.effect for d in plan.decisions if d.called_for}
    assert not called_for & {"depth layers", "occlusion"}


def test_layers_follow_the_blur_not_the_distance():
    """From 2 m to infinity the blur changes as much as from 1 m to 2 m: by half a dioptre."""
    near = plan_photo(flat(torch.linspace(0.5, 1.0, 64).expand(4, 64)), CAMERA).settings["layers"]
    far = plan_photo(flat(torch.linspace(0.0, 0.5, 64).expand(4, 64)), CAMERA).settings["layers"]
    assert near == far > 2


def test_a_smaller_aperture_calls_for_fewer_layers():
    view = flat(torch.linspace(0.0, 2.0, 64).expand(4, 64))
    small = Camera.from_recipe(CameraRecipe(name="small", lens=Lens(aperture_radius_mm=0.5)))
    # a fifth of the aperture, a fifth of the blur: a fifth of the steps between the outermost two layers
    steps = [plan_photo(view, camera).settings["layers"] - 2 for camera in (small, CAMERA)]
    assert 0 < steps[0] <= steps[1] / 4


def test_a_slanted_surface_has_no_edges_and_a_step_has():
    slanted = torch.linspace(0.5, 1.5, 200).expand(4, 200)
    step = torch.where(torch.arange(200) < 100, 2.0, 0.0).expand(4, 200)
    assert not decision(flat(slanted), "occlusion").called_for
    assert decision(flat(step), "occlusion").called_for


def test_hidden_surfaces_are_used_where_they_are_known():
    step = torch.where(torch.arange(20) < 10, 2.0, 0.0).expand(4, 20)
    assert decision(flat(step), "occlusion").chosen == "normalised"
    assert decision(flat(step, hidden=(9, 29)), "occlusion").chosen == "hidden"


def test_what_the_user_insists_on_is_marked():
    plan = plan_photo(flat(torch.rand(4, 4)), CAMERA, {"layers": 3, "occlusion": None})
    (layers,) = [d for d in plan.decisions if d.effect == "depth layers"]
    assert plan.settings["layers"] == 3 and layers.overruled and layers.chosen == "3 layers"
    assert not any(d.overruled for d in plan.decisions if d.effect != "depth layers")


def test_spherical_aberration_follows_the_fourth_power_of_the_aperture():
    """Seidel: the wave aberration of the paper's aperture is above a quarter wave, that of a quarter of it
    (1/256) is not."""
    narrow = Camera.from_recipe(CameraRecipe(name="narrow", lens=Lens(aperture_radius_mm=0.625)))
    view = flat(torch.rand(4, 4))
    assert decision(view, "exact lens").called_for
    assert not decision(view, "exact lens", narrow).called_for


@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_noise_is_called_for_where_the_camera_has_it(noise: float):
    camera = Camera.from_recipe(CameraRecipe(name="noise", sensor=Sensor(read_noise=noise)))
    assert decision(flat(torch.rand(4, 4)), "sensor noise", camera).called_for is (noise > 0)


def test_a_thumbnail_shows_the_same_field_with_fewer_pixels():
    recipe = load_scene("desk").recipe
    small = thumbnail(recipe)
    assert max(small.frame.width_px, small.frame.height_px) <= 64
    field = recipe.frame.width_px * recipe.frame.pixel_angle_mrad
    assert small.frame.width_px * small.frame.pixel_angle_mrad == pytest.approx(field, rel=0.05)
    assert small.objects == recipe.objects and small.render.samples <= 16
