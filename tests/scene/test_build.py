"""Placement, and what is refused: one sentence a problem, all of them at once."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from edofsim.errors import InputError
from edofsim.recipe.scene import Frame, SceneRecipe
from edofsim.scene import build_scene
from edofsim.scene.placement import half_frame, rotation
from edofsim.scene.spectra import luminance

SKY = [{"kind": "sky"}]
CARD = {"kind": "panel", "width_mm": 10, "height_mm": 10, "depth_m": 1.0}


def recipe(*objects: dict, lights=SKY) -> SceneRecipe:
    return SceneRecipe.model_validate({"name": "test", "objects": list(objects), "lights": lights})


def problems(*objects: dict, base: Path = Path("."), lights=SKY) -> tuple[str, ...]:
    with pytest.raises(InputError) as caught:
        build_scene(recipe(*objects, lights=lights), base)
    return caught.value.problems


def box(model, name: str) -> tuple[np.ndarray, np.ndarray]:
    vertices = np.concatenate([o.mesh.vertices for o in model.objects if o.name.split("/")[0] == name])
    return vertices.min(axis=0), vertices.max(axis=0)


def test_frame_fractions_are_edges_of_the_frame():
    """512 pixels of 0.1626 mrad are 42 mm at 0.5 m, 371 mm at 4.46 m."""
    assert half_frame(Frame(), 0.5)[0] * 2 == pytest.approx(0.0416, abs=1e-4)
    assert half_frame(Frame(), 4.46)[0] * 2 == pytest.approx(0.371, abs=1e-3)
    card = {**CARD, "depth_m": 0.5, "x_frame": 1.0, "y_frame": -1.0, "name": "card"}
    low, high = box(build_scene(recipe(card), Path(".")), "card")
    np.testing.assert_allclose((low + high) / 2, [0.0208144, -0.0156108, 0.5], atol=1e-6)


def test_turns_go_the_ways_that_the_recipe_says():
    front, top, right = np.array([0, 0, -1]), np.array([0, 1, 0]), np.array([1, 0, 0])
    assert (rotation(20, 0, 0) @ front)[0] < 0  # positive turn: the front looks left
    assert (rotation(0, 20, 0) @ top)[2] > 0  # positive tilt: the top leans away
    assert (rotation(0, 0, 20) @ right)[1] > 0  # positive roll: counter-clockwise
    assert np.linalg.det(rotation(10, 20, 30)) == pytest.approx(1)


def test_things_stand_on_what_they_name_however_they_are_turned():
    table = {"kind": "table", "name": "table", "y_mm": -20, "near_m": 0.5, "far_m": 2}
    block = {"kind": "box", "name": "block", "width_mm": 9, "height_mm": 5, "length_mm": 7, "depth_m": 1.0}
    card = {**CARD, "name": "card", "anchor": "base", "on": "block", "tilt_deg": 33, "roll_deg": 12}
    model = build_scene(recipe(table, {**block, "on": "table", "turn_deg": 40}, card), Path("."))
    assert box(model, "block")[0][1] == pytest.approx(-0.020, abs=1e-6)
    assert box(model, "block")[1][1] == pytest.approx(-0.015, abs=1e-6)
    assert box(model, "card")[0][1] == pytest.approx(-0.015, abs=1e-6)


def test_a_lamp_shines_towards_its_target_in_its_own_colour():
    lamp = {
        "kind": "area",
        "position_mm": [0, 500, 500],
        "target_mm": [0, 0, 1000],
        "radiance": 3.0,
        "illuminant": "E",
    }
    model = build_scene(recipe(CARD, lights=[lamp]), Path("."))
    shine = next(o for o in model.objects if o.emission is not None)
    a, b, c = shine.mesh.vertices[shine.mesh.faces[0]]
    normal = np.cross(b - a, c - a)
    np.testing.assert_allclose(normal / np.linalg.norm(normal), np.array([0, -1, 1]) / np.sqrt(2), atol=1e-5)
    np.testing.assert_allclose(shine.emission, 3.0, rtol=1e-3)


def test_the_sky_is_brightest_where_the_recipe_says():
    """With one colour for all of the sky, every direction's luminance is the recipe's figure."""
    sky = {"kind": "sky", "radiance": 2.0, "zenith": 0.5, "ground": 0.25, "ground_reflectance": 0.5}
    sky |= {"horizon_cct_k": 6500, "zenith_cct_k": 6500}
    model = build_scene(recipe(CARD, lights=[sky]), Path("."))
    env = model.environment.radiance
    rows = (env.image @ env.basis)[:, 0]
    got = [luminance(rows[i], model.wavelengths * 1e9) for i in (0, len(rows) // 2 - 1, -1)]
    np.testing.assert_allclose(got, [1.0, 2.0, 0.5], rtol=0.03)


def test_an_object_behind_the_camera_is_refused():
    (only,) = problems({**CARD, "name": "card", "depth_m": -1.0})
    assert only.startswith("card lies behind the camera") and "depth_m" in only


def test_an_object_that_reaches_behind_the_camera_is_refused():
    (only,) = problems({"kind": "sphere", "name": "ball", "radius_mm": 700, "depth_m": 0.5})
    assert only.startswith("ball reaches behind the camera")


def test_a_texture_that_is_not_an_image_names_file_and_object(tmp_path: Path):
    (tmp_path / "notes.png").write_text("this is no picture")
    surface = {"kind": "matt", "texture": {"kind": "file", "path": "notes.png"}}
    (only,) = problems({**CARD, "name": "poster", "surface": surface}, base=tmp_path)
    assert "poster" in only and "notes.png" in only and "not a picture" in only


def test_a_missing_texture_names_file_and_object(tmp_path: Path):
    surface = {"kind": "matt", "texture": {"kind": "file", "path": "none.png"}}
    (only,) = problems({**CARD, "name": "poster", "surface": surface}, base=tmp_path)
    assert "poster" in only and "none.png" in only and "does not exist" in only


def test_a_mesh_with_vertices_that_are_not_finite_is_refused(tmp_path: Path):
    (tmp_path / "bad.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 nan 0\nf 1 2 3\n")
    (only,) = problems(
        {"kind": "mesh", "name": "thing", "path": "bad.obj", "size_mm": 5, "depth_m": 1}, base=tmp_path
    )
    assert "thing" in only and "bad.obj" in only and "1 of the 3 vertices" in only


@pytest.mark.parametrize(
    ("name", "content", "complaint"),
    [
        ("none.ply", None, "does not exist"),
        ("empty.obj", "# nothing\n", "no triangles"),
        ("flat.obj", "v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n", "no triangle with an area"),
        ("words.ply", "hello", "cannot be read"),
        ("scene.blend", "x", "not of a known kind"),
    ],
)
def test_meshes_that_cannot_be_used_are_refused(
    tmp_path: Path, name: str, content: str | None, complaint: str
):
    if content is not None:
        (tmp_path / name).write_text(content)
    item = {"kind": "mesh", "name": "thing", "path": name, "size_mm": 5, "depth_m": 1}
    (only,) = problems(item, base=tmp_path)
    assert "thing" in only and name in only and complaint in only


def test_an_unknown_spectrum_names_object_and_nearest():
    (only,) = problems({**CARD, "name": "card", "surface": {"kind": "matt", "reflectance": "orang"}})
    assert only.startswith("card:") and "'orange'" in only


def test_all_problems_are_told_at_once():
    found = problems(
        {**CARD, "name": "same"},
        {**CARD, "name": "same", "depth_m": -2},
        {**CARD, "name": "metal", "surface": {"kind": "metal", "metal": "unobtainium"}},
        {**CARD, "name": "lost", "anchor": "base", "on": "nothing"},
    )
    text = "\n".join(found)
    assert len(found) == 4
    for word in ("name 'same'", "behind the camera", "unobtainium", "stands on 'nothing'"):
        assert word in text


def test_a_scene_without_light_is_refused():
    (only,) = problems(CARD, lights=[])
    assert "no light" in only


def test_two_lights_at_infinity_are_refused():
    (only,) = problems(CARD, lights=[{"kind": "sky"}, {"kind": "environment"}])
    assert "lights[1]" in only


def test_bands_outside_the_data_of_a_light_are_refused():
    scene = recipe(CARD, lights=[{"kind": "environment", "illuminant": "LED-B1"}])
    wide = scene.model_copy(update={"bands": scene.bands.model_copy(update={"stop_nm": 830.0})})
    with pytest.raises(InputError, match="380 to 780 nm"):
        build_scene(wide, Path("."))


def test_own_textures_and_meshes_are_found_from_the_recipes_folder(tmp_path: Path):
    from skimage.io import imsave

    picture = np.zeros((4, 6, 3), np.uint8)
    picture[0] = 255  # a white top row
    imsave(tmp_path / "a.png", picture, check_contrast=False)
    surface = {"kind": "matt", "texture": {"kind": "file", "path": "a.png"}}
    texture = build_scene(recipe({**CARD, "surface": surface}), tmp_path).objects[0].surface.reflectance
    values = texture.image @ texture.basis
    np.testing.assert_allclose(values[0], 1, atol=1e-6)
    np.testing.assert_allclose(values[1:], 0, atol=1e-6)
