"""Mitsuba scenes that many bands cannot share a path in: the same frame, fragments and files, Mitsuba's
light."""

from __future__ import annotations

import json
import subprocess
import sys

import numpy as np
import OpenEXR
import pytest

from edofsim.errors import InputError
from edofsim.recipe import SceneRecipe
from edofsim.render import render

SCENE = """<scene version="3.0.0">
  <sensor type="perspective"><transform name="to_world">
    <lookat origin="0, 0, 300" target="0, 0, 0" up="0, 1, 0"/></transform></sensor>
  <emitter type="constant"><spectrum name="radiance" value="2"/></emitter>
  <shape type="rectangle">
    <transform name="to_world"><scale value="400"/><translate z="-100"/></transform>
    <bsdf type="blendbsdf"><float name="weight" value="0.25"/>
      <bsdf type="diffuse"><spectrum name="reflectance" value="400:0.2, 800:1.0"/></bsdf>
      <bsdf type="diffuse"><spectrum name="reflectance" value="0.4"/></bsdf>
    </bsdf>
  </shape>
  <shape type="sphere"><float name="radius" value="20"/><point name="center" x="40" y="40" z="100"/>
    <bsdf type="diffuse"><spectrum name="reflectance" value="0.5"/></bsdf></shape>
</scene>
"""


def recipe(**more):
    data = {
        "name": "own",
        "bands": {"count": 6},
        "frame": {"width_px": 16, "height_px": 16, "margin_px": 0, "pixel_angle_mrad": 40.0},
        "render": {"samples": 64, "max_depth": 2, "pupil_radius_mm": 60.0},
        "source": {"kind": "mitsuba", "path": "own.xml", "units_m": 0.01},
    }
    return SceneRecipe.model_validate({**data, **more})


def test_spectral_variant_renders_what_bands_cannot_share(tmp_path, caplog):
    """A blend of two BSDFs in even light: closed form (1 - w) rho1 + w rho2 times the light in every band.
    The reason is told; depth, the ball's place and the wall behind it are those of the file."""
    (tmp_path / "own.xml").write_text(SCENE)
    view = render(recipe(), tmp_path, cache=tmp_path)
    assert "blendbsdf" in caplog.text and "spectral variant" in caplog.text
    assert "blendbsdf" in view.metadata["route"]
    nm = np.linspace(420, 720, 6)
    expected = 2 * (0.75 * (0.2 + 0.8 * (nm - 400) / 400) + 0.25 * 0.4)
    image, depth = view.all_in_focus().numpy(), view.mean_inverse_depth().numpy()
    assert depth[10:, :6] == pytest.approx(1 / 4, rel=1e-3)  # 300 + 100 units of a centimetre
    far_from_ball = image[:, 10:, :6]
    assert far_from_ball.mean(axis=(1, 2)) == pytest.approx(expected, rel=0.03)
    # The ball's centre is at x = 40, y = 40, 200 units away; the file's camera has x to the left, a picture
    # right: seen from +z towards -z with y up, +x is on the right
    row, column = np.unravel_index(np.argmax(depth), depth.shape)
    assert (column + 0.5 - 8) * 0.04 == pytest.approx(0.2, abs=0.05)
    assert (8 - row - 0.5) * 0.04 == pytest.approx(0.2, abs=0.05)
    assert depth.max() == pytest.approx(1 / 1.8, rel=0.02)
    assert view.hidden.any() and view.inverse_depth[view.hidden].numpy() == pytest.approx(0.25, rel=1e-3)


ONE_THREAD = """
from pathlib import Path
from edofsim.recipe import SceneRecipe
from edofsim.render import cache
from edofsim.render.engine import set_threads
from edofsim.render.fetch import fetch
import drjit, sys
set_threads(1)
folder = Path(sys.argv[1])
recipe = SceneRecipe.model_validate_json((folder / "own.json").read_text())
view, _ = cache.load(fetch(recipe, folder, folder, None, "auto", None).place, aside=False)
assert "blendbsdf" in view.metadata["route"]
print(float(view.all_in_focus().mean()), drjit.thread_count())
"""


def test_an_openexr_picture_is_read_on_one_thread(tmp_path):
    """As a machine of one core renders, and a worker that has one. It would wait for ever: so the child
    process has a time limit. A wall of 0.5 in even light of 2; the engine has its one thread again."""
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    grey = np.full((8, 8), 0.5, np.float32)
    OpenEXR.File(header, dict.fromkeys("RGB", grey)).write(str(tmp_path / "wall.exr"))
    texture = '<texture name="reflectance" type="bitmap"><string name="filename" value="wall.exr"/></texture>'
    plain = '<spectrum name="reflectance" value="400:0.2, 800:1.0"/>'
    scene = SCENE.replace(plain, texture).replace('value="0.4"', 'value="0.5"')
    assert texture in scene
    (tmp_path / "own.xml").write_text(scene)
    (tmp_path / "own.json").write_text(recipe().model_dump_json(by_alias=True))
    command = [sys.executable, "-c", ONE_THREAD, str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    mean, threads = done.stdout.split()
    assert float(mean) == pytest.approx(1, rel=0.06) and threads == "1"


def test_same_bytes_twice_and_noise(tmp_path):
    (tmp_path / "own.xml").write_text(SCENE)
    one = render(recipe(), tmp_path, cache=tmp_path / "one")
    two = render(recipe(), tmp_path, cache=tmp_path / "two")
    assert one.radiance.numpy().tobytes() == two.radiance.numpy().tobytes() and 0 < one.noise < 0.2


def test_json_scene(tmp_path):
    scene = {
        "type": "scene",
        "sensor": {"type": "perspective"},
        "light": {"type": "constant"},
        "wall": {
            "type": "rectangle",
            "to_world": np.diag([9.0, 9.0, 1.0, 1.0]).tolist(),
            "bsdf": {
                "type": "mask",
                "opacity": 1.0,
                "inner": {"type": "diffuse", "reflectance": {"type": "uniform", "value": 0.5}},
            },
        },
    }
    scene["wall"]["to_world"][2][3] = 2.0
    (tmp_path / "own.json").write_text(json.dumps(scene))
    view = render(recipe(source={"kind": "mitsuba", "path": "own.json"}), tmp_path, cache=tmp_path)
    assert view.inverse_depth.numpy() == pytest.approx(0.5, rel=1e-3)


@pytest.mark.parametrize(
    "change, complaint",
    [
        ({"lights": [{"kind": "environment"}]}, "takes no"),
        ({"source": {"kind": "mitsuba", "path": "outside.xml"}}, "outside the scene's folder"),
    ],
)
def test_what_cannot_be_used_is_one_message(tmp_path, change, complaint):
    (tmp_path / "own.xml").write_text(SCENE)
    texture = (
        '<texture type="bitmap" name="reflectance"><string name="filename" value="../secret.png"/></texture>'
    )
    (tmp_path / "outside.xml").write_text(
        SCENE.replace('<spectrum name="reflectance" value="0.4"/>', texture)
    )
    with pytest.raises(InputError, match=complaint):
        render(recipe(**change), tmp_path, cache=tmp_path)
