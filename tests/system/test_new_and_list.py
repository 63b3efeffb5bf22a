"""`edofsim new` gives recipes that can be used as they are, and `edofsim list` names all that there is."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from edofsim.recipe import load_camera, load_scene, shipped, shipped_folder
from edofsim.recipe.kinds import MASKS, NETWORKS, OBJECTS
from edofsim.recipe.load import load_train
from edofsim.recipe.new import new_recipe
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


def test_a_new_camera_has_a_lens_and_a_new_training_names_what_there_is(tmp_path: Path):
    from edofsim.optics import Camera

    camera = load_camera(new_recipe("camera", tmp_path / "c"))
    assert Camera.from_recipe(camera.recipe, camera.base).sensor_distance > 0.03
    training = load_train(new_recipe("train", tmp_path / "t.toml")).recipe
    assert training.name == "t"
    assert load_camera(training.camera).recipe.name == training.camera


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
    ],
)
def test_a_list_has_all_of_them_with_a_line_each(things: str, names: Callable, capfd):
    from edofsim.cli import invoke
    from edofsim.console import exit_status

    assert exit_status(lambda: invoke(["list", things])) == 0
    lines = [line.split(maxsplit=1) for line in capfd.readouterr().out.splitlines()[1:]]
    said = {words[0] for words in lines if len(words) == 2}
    assert set(names()) <= said
