"""`edofsim render` does without PyTorch: the angle of the camera's pixel is kept from the first time on."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from edofsim.cli import angles
from edofsim.core.store import user_folder
from edofsim.errors import InputError
from edofsim.optics import Camera
from edofsim.recipe import load_camera, load_scene
from edofsim.recipe.kinds import LENSES
from edofsim.render.engine import find_engines
from edofsim.scene import build_scene

SCENE = """
name = "card"
camera = "own.toml"
frame = { width_px = 8, height_px = 6, margin_px = 1 }
render = { samples = 2, max_depth = 2 }
lights = [{ kind = "environment" }]
objects = [{ kind = "wall", depth_m = 2.0 }]
"""
CAMERA = 'name = "own"\nsensor = { pixel_um = 3.45 }\n'
RENDERED_AND_LOADED = """
import sys
from edofsim.cli import invoke
invoke(["render", sys.argv[1], "--cache", sys.argv[2], "--quiet"])
print("loaded", "torch" in sys.modules)
"""


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty home, and beside it a camera of one's own."""
    monkeypatch.setattr(angles, "user_folder", lambda: tmp_path / "home")
    (tmp_path / "own.toml").write_text(CAMERA)
    return tmp_path


def true_angle(path: Path) -> float:
    found = load_camera(path)
    return Camera.from_recipe(found.recipe, found.base).pixel_angle


def kept_in(home: Path) -> list[Path]:
    return sorted((home / "home" / "angles").glob("*.json"))


def test_torch_is_loaded_for_a_camera_s_first_rendering_only(tmp_path: Path):
    """Which engines work and the light's spectrum are known before."""
    (tmp_path / "card.toml").write_text(SCENE)
    (tmp_path / "own.toml").write_text(CAMERA)
    find_engines()
    build_scene(load_scene(tmp_path / "card.toml").recipe, tmp_path)
    shutil.copytree(user_folder(), tmp_path / "home" / "edofsim", ignore=lambda *_: ["angles"])
    environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path / "home")}
    said = []
    for folder in ("one", "two"):
        command = [sys.executable, "-c", RENDERED_AND_LOADED, tmp_path / "card.toml", tmp_path / folder]
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
        said.append(done.stdout.splitlines()[-1])
    assert said == ["loaded True", "loaded False"]
    one, two = (next((tmp_path / folder).glob("*.exr")) for folder in ("one", "two"))
    assert one.name == two.name and one.read_bytes() == two.read_bytes()


def test_the_angle_is_the_camera_s_and_is_kept(home: Path, monkeypatch: pytest.MonkeyPatch):
    path = home / "own.toml"
    assert angles.pixel_angle("own.toml", home) == true_angle(path)
    assert angles.pixel_angle("paper-cubic", home) == true_angle(Path("paper-cubic"))
    assert len(kept_in(home)) == 2
    with monkeypatch.context() as patch:
        patch.setattr(angles, "load_camera", None)  # nobody asks
        assert angles.pixel_angle(path, home) == true_angle(path)
    path.write_text(CAMERA.replace("3.45", "4.5"))
    assert angles.pixel_angle(path, home) == true_angle(path)
    assert len(kept_in(home)) == 3


@pytest.mark.parametrize("content", ["", "null", "NaN", "-1.0", '"many"', "[1.0]"])
def test_a_damaged_file_is_made_anew(home: Path, content: str):
    angle = angles.pixel_angle("own.toml", home)
    (kept,) = kept_in(home)
    kept.write_text(content)
    assert angles.pixel_angle("own.toml", home) == angle
    assert json.loads(kept.read_text()) == angle


def test_what_another_package_s_lens_gives_is_not_kept(home: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(type(LENSES), "code_of", lambda registry, kind: "its code")
    angles.pixel_angle("own.toml", home)
    assert not kept_in(home)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("name = ", "not valid TOML"),
        ('name = "own"\nfocus = { distance_m = 0.01 }', "inside the focal length"),
    ],
)
def test_a_camera_that_is_none_is_one_message(home: Path, text: str, said: str):
    (home / "own.toml").write_text(text)
    with pytest.raises(InputError, match=said):
        angles.pixel_angle("own.toml", home)
    with pytest.raises(InputError, match="no such file"):
        angles.pixel_angle("none", home)
    assert not kept_in(home)
