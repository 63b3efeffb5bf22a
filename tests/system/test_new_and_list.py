"""`edofsim new` gives recipes that can be used as they are, and `edofsim list` names all that there is."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import skimage.io

from edofsim.core.images import write_png
from edofsim.plan import EFFECTS
from edofsim.recipe import load_camera, load_scene, shipped, shipped_folder
from edofsim.recipe.kinds import MASKS, NETWORKS, OBJECTS
from edofsim.recipe.load import load_dataset, load_member_scene, load_train
from edofsim.recipe.new import new_recipe
from edofsim.render.readers import picture_view
from edofsim.restore.checkpoint import comparison_checkpoints, shipped_checkpoints

Run = Callable[..., tuple[int, str]]


def test_a_new_scene_can_be_built(tmp_path: Path):
    from edofsim.scene import build_scene

    path = new_recipe("scene", tmp_path / "mine")
    loaded = load_scene(path)
    recipe = loaded.recipe.model_copy(
        update={"frame": loaded.recipe.frame.model_copy(update={"pixel_angle_mrad": 0.16})}
    )
    assert recipe.name == "mine" and "@" not in path.read_text()
    assert len(build_scene(recipe, loaded.base).objects) >= 3


def test_a_new_dataset_photographs_what_there_is(tmp_path: Path):
    loaded = load_dataset(new_recipe("dataset", tmp_path / "pairs"))
    assert loaded.recipe.name == "pairs" and load_camera(loaded.recipe.cameras[0])
    assert load_member_scene(loaded.recipe.scenes[0].recipe, loaded.base)


def test_a_new_camera_has_a_lens_and_a_new_training_names_what_there_is(tmp_path: Path):
    from edofsim.optics import Camera

    camera = load_camera(new_recipe("camera", tmp_path / "c"))
    assert Camera.from_recipe(camera.recipe, camera.base).sensor_distance > 0.03
    training = load_train(new_recipe("train", tmp_path / "t.toml")).recipe
    assert training.name == "t"
    assert load_camera(training.camera).recipe.name == training.camera


@pytest.mark.parametrize(("name", "unit"), [("depth.npy", 1.0), ("depth.png", 1e-3)])
def test_a_new_scene_of_a_picture_has_its_size_and_depths(
    edofsim: Run, tmp_path: Path, name: str, unit: float
):
    depth = np.linspace(0.6, 3.0, 40) * np.ones((30, 1))
    write_png(tmp_path / "photo.png", np.random.default_rng(0).random((3, 30, 40)))
    if name.endswith(".png"):
        skimage.io.imsave(tmp_path / name, (1000 * depth).astype(np.uint16), check_contrast=False)
    else:
        np.save(tmp_path / name, depth)
    (tmp_path / "recipes").mkdir()
    given = ("--image", tmp_path / "photo.png", "--depth", tmp_path / name)
    assert edofsim("new", "scene", tmp_path / "recipes" / "mine", *given)[0] == 0
    loaded = load_scene(tmp_path / "recipes" / "mine.toml")
    assert (loaded.recipe.frame.width_px, loaded.recipe.frame.height_px) == (40, 30)
    assert loaded.recipe.source.depth.unit == unit
    frame = loaded.recipe.frame.model_copy(update={"pixel_angle_mrad": 0.16})
    view = picture_view(loaded.recipe.model_copy(update={"frame": frame}), loaded.base)
    inside = view.crop_margin(view.mean_inverse_depth())
    assert np.allclose(inside, 1 / depth, rtol=2e-3)


def test_a_picture_without_its_depths_makes_no_scene(edofsim: Run, tmp_path: Path):
    write_png(tmp_path / "photo.png", np.zeros((3, 30, 40)))
    np.save(tmp_path / "depth.npy", np.ones((3, 4)))
    status, said = edofsim("new", "scene", tmp_path / "mine", "--image", tmp_path / "photo.png")
    assert status == 2 and "go together" in said
    given = ("--image", tmp_path / "photo.png", "--depth", tmp_path / "depth.npy")
    status, said = edofsim("new", "scene", tmp_path / "mine", *given)
    assert status == 2 and "4 x 3 pixels" in said and not (tmp_path / "mine.toml").exists()


def test_a_recipe_that_is_there_is_not_written_over(edofsim: Run, tmp_path: Path):
    assert edofsim("new", "scene", tmp_path / "mine")[0] == 0
    before = (tmp_path / "mine.toml").read_text()
    status, said = edofsim("new", "camera", tmp_path / "mine")
    assert status == 2 and "is there already" in said
    assert (tmp_path / "mine.toml").read_text() == before


@pytest.mark.parametrize("name", ["a name", "-x", "ä"])
def test_a_name_that_no_recipe_can_have_is_refused(edofsim: Run, tmp_path: Path, name: str):
    status, said = edofsim("new", "scene", tmp_path / f"{name}.toml")
    assert status == 2 and "cannot name a recipe" in said and not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("things", "names"),
    [
        ("scenes", lambda: shipped(shipped_folder("scenes"))),
        ("cameras", lambda: shipped(shipped_folder("scenes") / "cameras")),
        ("trainings", lambda: shipped(shipped_folder("train"))),
        ("masks", lambda: MASKS),
        ("objects", lambda: OBJECTS),
        ("networks", lambda: NETWORKS),
        ("checkpoints", lambda: shipped_checkpoints() | comparison_checkpoints()),
        ("effects", lambda: {name.split()[0] for name in EFFECTS}),
    ],
)
def test_a_list_has_all_of_them_with_a_line_each(things: str, names: Callable, capfd):
    from edofsim.cli import invoke
    from edofsim.console import exit_status

    assert exit_status(lambda: invoke(["list", things])) == 0
    lines = [line.split(maxsplit=1) for line in capfd.readouterr().out.splitlines()[1:]]
    said = {words[0] for words in lines if len(words) == 2}
    assert set(names()) <= said
