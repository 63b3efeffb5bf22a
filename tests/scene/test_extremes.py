"""Sizes at the ends of what a number can be end in one sentence, before anything is rendered."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
from PIL import Image
from scipy.io import savemat

from edofsim.core import limits
from edofsim.errors import InputError
from edofsim.recipe.scene import SceneRecipe
from edofsim.render.readers.pictures import picture_view
from edofsim.scene import build_scene

LIGHT = {"kind": "environment"}


def recipe(*objects: dict, **more) -> SceneRecipe:
    placed = [{"depth_m": 1.0, **item} for item in objects]
    return SceneRecipe.model_validate({"name": "a", "objects": placed, "lights": [LIGHT], **more})


@pytest.mark.parametrize(
    "item, complaint",
    [
        ({"kind": "book", "height_mm": 1e30, "title": "A"}, "print would be"),
        ({"kind": "book", "thickness_mm": 1e-30, "title": "A"}, "print would be"),
        ({"kind": "text_page", "width_mm": 1e30}, "print would be"),
        ({"kind": "text_page", "height_mm": 1e-30}, "print would be"),
        ({"kind": "pencil", "width_mm": 1e-30}, "too thin or too small"),
        ({"kind": "sphere", "radius_mm": 1e30}, "behind the camera"),
    ],
)
def test_sizes_that_no_thing_has(item: dict, complaint: str):
    with pytest.raises(InputError, match=complaint):
        build_scene(recipe(item), Path("."))


def test_an_environment_too_bright_to_add_up(tmp_path: Path):
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    plane = np.full((4, 8), 3e38, np.float32)
    OpenEXR.File(header, dict.fromkeys("RGB", plane)).write(str(tmp_path / "sky.exr"))
    lights = [{"kind": "environment_map", "path": "sky.exr"}]
    with pytest.raises(InputError, match="its radiance is not finite, or more than"):
        build_scene(recipe({"kind": "sphere", "radius_mm": 1}, lights=lights), tmp_path)


@pytest.mark.parametrize("number", ["nan", "inf", "-inf"])
def test_foreign_scenes_hold_finite_numbers(tmp_path: Path, number: str):
    shape = f'<shape type="sphere"><float name="radius" value="{number}"/></shape>'
    sensor, light = '<sensor type="perspective"/>', '<emitter type="constant"/>'
    (tmp_path / "a.xml").write_text(f'<scene version="3.0.0">{sensor}{shape}{light}</scene>')
    source = {"kind": "mitsuba", "path": "a.xml"}
    with pytest.raises(InputError, match="not finite"):
        build_scene(recipe(source=source, lights=[]), tmp_path)


def test_files_that_say_more_than_memory_holds(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    Image.new("1", (13000, 13000)).save(tmp_path / "a.png")
    surface = {"kind": "matt", "texture": {"kind": "file", "path": "a.png"}}
    panel = {"kind": "panel", "width_mm": 1, "height_mm": 1, "surface": surface}
    with pytest.raises(InputError, match="13000 x 13000 pixels, too many"):
        build_scene(recipe(panel), tmp_path)
    said = {"descr": "|b1", "fortran_order": False, "shape": (20000, 20000)}
    with zipfile.ZipFile(tmp_path / "z.npz", "w") as archive, archive.open("a.npy", "w") as member:
        np.lib.format.write_array_header_1_0(member, said)  # of numbers that do not follow
    depth = {"kind": "rgbd", "image": "skimage:astronaut", "depth": {"path": "z.npz"}}
    with pytest.raises(InputError, match="20000 x 20000 numbers"):
        picture_view(recipe(source=depth, lights=[]), tmp_path)
    monkeypatch.setattr(limits, "MAX_NUMBERS", 1 << 18)
    savemat(tmp_path / "c.mat", {"c": np.zeros((100, 100, 31), np.uint8)}, do_compression=True)
    cube = {"kind": "cube", "path": "c.mat", "start_nm": 400, "step_nm": 10, "depth_m": 1.0}
    with pytest.raises(InputError, match="100 x 100 x 31 numbers"):
        picture_view(recipe(source=cube, lights=[]), tmp_path)
