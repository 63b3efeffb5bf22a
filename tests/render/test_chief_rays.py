"""Views through a lens that distorts: points are where their chief rays land, hidden ones as well."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from edofsim.capture import Fidelity, capture
from edofsim.capture.framing import framed
from edofsim.errors import InputError
from edofsim.optics import Camera
from edofsim.optics.prescription.trace import trace
from edofsim.recipe.load import load_camera, load_scene
from edofsim.recipe.scene import SceneRecipe, SeenFrame
from edofsim.render.keys import canonical
from edofsim.render.rendering import render_model
from edofsim.render.view import View

WIDTH, HEIGHT = 240, 160


def coarse(name: str, pixel_um: float) -> Camera:
    """A shipped lens in pixels so large that its distortion is seen in a small frame."""
    recipe = load_camera(name).recipe
    sensor = recipe.sensor.model_copy(update={"pixel_um": pixel_um})
    return Camera.from_recipe(recipe.model_copy(update={"sensor": sensor}))


@pytest.fixture(scope="module")
def phone() -> Camera:
    return coarse("aspheres-5mm-f3", 12.0)


def lands(camera: Camera, height: float, depth: float) -> float:
    """How far from the axis [m] a point at a height and depth [m] is on the sensor: by bisection for the ray
    from it through the centre of the stop."""
    held = camera.lens.held()
    index = held.lens.index(torch.tensor([held.wavelength], dtype=torch.float64))[:, None]
    away = torch.tensor([[depth * 1e3 - held.first.entrance]], dtype=torch.float64)
    low, high = (torch.full_like(away, height * 1e3 / depth * 1e-3 * k) for k in (0.7, 1.4))
    for _ in range(60):
        slope = (low + high) / 2
        along = 1 / torch.sqrt(1 + slope**2)
        start = torch.zeros_like(slope), torch.full_like(slope, height * 1e3), -away
        direction = torch.zeros_like(slope), -slope * along, along
        rays = trace(held.lens, index, start, direction, (held.lens.stop,))
        above = rays.at[held.lens.stop][1] > 0  # it came in too flat
        low, high = torch.where(above, slope, low), torch.where(above, high, slope)
    return float(-rays.to_plane(held.sensor).y) * 1e-3


def settings(make, camera: Camera, **more):
    corner = math.hypot(WIDTH / 2, HEIGHT / 2) * camera.pixel_angle
    how = {"angle": camera.pixel_angle, "chief_rays": camera.lens.chief_rays(corner), **more}
    return make.settings(WIDTH, HEIGHT, **how)


@pytest.mark.parametrize(
    "name, pixel_um, near, moves",
    [("aspheres-5mm-f3", 12.0, 0.4, 0.5), ("double-gauss-50mm-f4", 90.0, 0.2, 0.4)],
)
def test_points_land_where_their_chief_rays_do(mi, make, name, pixel_um, near, moves):
    """The entrance pupil of the double Gauss wanders with the field, by a third of a pixel at 0.2 m."""
    camera = coarse(name, pixel_um)
    seen = [(0.0500, 0.0, near), (-0.125, 0.075, near), (0.19, -0.12, near), (-0.18, -0.12, 5 * near)]
    places = [(x * z, y * z, z) for x, y, z in seen]
    size = 4 * camera.pixel_angle
    shown = [
        make.thing(
            f"lamp {k}", make.facing(size * z, size * z, z, x, y), make.matt(0.0, 2), emission=np.ones(2)
        )
        for k, (x, y, z) in enumerate(places)
    ]
    how = settings(make, camera, samples=64, max_depth=1, hidden=False)
    image = View.of(render_model(make.model(shown, bands=2), how)).all_in_focus()[0].numpy()
    rows, columns = np.mgrid[:HEIGHT, :WIDTH] + 0.5
    moved = []
    for x, y, z in places:
        off = math.hypot(x, y)
        height = lands(camera, off, z) / (pixel_um * 1e-6)
        column, row = WIDTH / 2 + height * x / off, HEIGHT / 2 - height * y / off
        lit = image * ((abs(rows - row) < 6) & (abs(columns - column) < 6))
        where = (lit * columns).sum() / lit.sum(), (lit * rows).sum() / lit.sum()
        assert where == pytest.approx((column, row), abs=0.1)
        moved.append(abs(off / z / camera.pixel_angle - height))
    assert max(moved) > moves


def test_what_is_hidden_is_seen_along_the_same_rays(mi, make, phone):
    """A stripe behind the edge of a card is where it is without the card."""
    card = make.thing("card", make.facing(1.0, 1.0, 0.4, 0.5 + 0.06, 0.0), make.matt(0.5, 2))
    stripe = make.thing(
        "stripe", make.facing(0.02, 4, 2.0, 0.312, 0.0), make.matt(0.0, 2), emission=np.ones(2)
    )
    wall = make.thing("wall", make.facing(8, 8, 2.5), make.matt(0.0, 2))
    how = {"samples": 64, "max_depth": 1, "pupil_radius": 3e-2}
    behind = View.of(render_model(make.model([card, stripe, wall], bands=2), settings(make, phone, **how)))
    alone = View.of(render_model(make.model([stripe, wall], bands=2), settings(make, phone, **how)))
    columns = torch.arange(WIDTH).repeat(HEIGHT) + 0.5

    def middle(view: View, some: torch.Tensor) -> float:
        some = some & (view.radiance[0] > 0)
        light = view.radiance[0, some]
        return float((light * columns[view.pixel[some]]).sum() / light.sum())

    assert middle(behind, behind.hidden) == pytest.approx(middle(alone, ~alone.hidden), abs=0.15)


def test_cameras_frame_scenes_along_their_chief_rays(phone):
    recipe = load_scene("desk").recipe
    seen = framed(recipe, phone)
    assert len(seen.frame.chief_rays) > 8
    assert framed(seen, phone) == seen
    assert SceneRecipe.model_validate(seen.model_dump()) == seen
    plain = framed(recipe, Camera.from_recipe(load_camera("paper-cubic").recipe))
    assert not isinstance(plain.frame, SeenFrame) and "chief_rays" not in canonical(plain)["frame"]
    assert framed(plain, phone, resample=True) == plain and framed(seen.seen_along(()), phone) == seen
    assert canonical(seen)["frame"]["chief_rays"]


def test_views_of_another_lens_are_refused(phone):
    view = View.flat(torch.ones(1, 40, 60), 1.0, wavelengths=[550e-9], pixel_angle=phone.pixel_angle)
    own = phone.lens.chief_rays(40 * phone.pixel_angle)
    other = tuple((place, 1.01 * ratio, at) for place, ratio, at in own)
    how = Fidelity(field_step_px=64, window_px=16)
    assert capture(replace(view, metadata={"chief_rays": own}), phone, how).how.distortion == "rendered"
    assert capture(view, phone, how).how.distortion == "as in the view"
    with pytest.raises(InputError, match="chief rays of another lens"):
        capture(replace(view, metadata={"chief_rays": other}), phone, how)
