"""The shipped desk: what its purpose promises is in the frame."""

from __future__ import annotations

import numpy as np
import pytest

from edofsim.recipe import load_scene
from edofsim.scene import build_scene


@pytest.fixture(scope="module")
def desk():
    loaded = load_scene("desk")
    return loaded.recipe, build_scene(loaded.recipe, loaded.base)


def test_depths_are_spread_from_half_a_metre_to_far_away(desk):
    """In inverse depth, where defocus is linear, no gap between neighbours is wider than 0.35 1/m."""
    _, model = desk
    things = [o for o in model.objects if o.name not in ("table", "wall", "lamp")]
    inverse = np.sort([0.0] + [1 / np.median(o.mesh.vertices[:, 2]) for o in things])
    assert inverse[-1] == pytest.approx(2.0, abs=0.05)
    assert np.diff(inverse).max() < 0.35


def test_every_object_is_in_the_frame(desk):
    recipe, model = desk
    half_x = recipe.frame.width_px / 2 * recipe.frame.pixel_angle_mrad * 1e-3
    half_y = recipe.frame.height_px / 2 * recipe.frame.pixel_angle_mrad * 1e-3
    weights = np.random.default_rng(0).dirichlet(np.ones(3), 64)
    seen: dict[str, bool] = {}
    for item in model.objects:
        points = np.einsum("pi,fik->pfk", weights, item.mesh.vertices[item.mesh.faces]).reshape(-1, 3)
        x, y, z = points[points[:, 2] > 0].T
        inside = (np.abs(x / z) < half_x) & (np.abs(y / z) < half_y)
        name = item.name.split("/")[0]
        seen[name] = bool(inside.any()) or seen.get(name, False)
    assert [name for name, inside in seen.items() if not inside] == ["lamp"]


def test_it_has_matt_plastic_and_metal_surfaces_in_few_programs(desk):
    _, model = desk
    kinds = {o.surface.bsdf["type"] for o in model.objects}
    assert kinds == {"diffuse", "roughplastic", "roughconductor"}
    assert len({tuple(sorted(o.surface.bsdf.items())) for o in model.objects}) <= 12


def test_it_is_the_same_scene_every_time(desk):
    recipe, model = desk
    again = build_scene(recipe, load_scene("desk").base)
    for a, b in zip(model.objects, again.objects, strict=True):
        assert a.mesh.vertices.tobytes() == b.mesh.vertices.tobytes()
        image = a.surface.reflectance.image
        assert image is None or image.tobytes() == b.surface.reflectance.image.tobytes()
