"""`edofsim expose --reference`: a crop by the slow truth beside the photo."""

from __future__ import annotations

import json

import pytest

from edofsim.capture import read_image
from edofsim.cli import app
from edofsim.recipe import load_camera

SCENE = """\
name = "cards"

[bands]
start_nm = 430
stop_nm = 700
count = 4

[frame]
width_px = 20
height_px = 16
margin_px = 12

[render]
samples = 16

[[objects]]
kind = "panel"
name = "card"
width_mm = 60
height_mm = 60
depth_m = 1.2
surface = { kind = "matt" }

[[objects]]
kind = "panel"
name = "small card"
x_mm = -2
width_mm = 4
height_mm = 40
depth_m = 0.8
surface = { kind = "matt", reflectance = "neutral 3.5" }

[[lights]]
kind = "sky"
"""


@pytest.mark.parametrize("name", ["pupil", "thinlens"])
def test_a_reference_beside_the_photo(tmp_path, name):
    """Files, figures and sizes; and the fast photo is near the slow one: the crop lies where it says."""
    scene, camera, out = tmp_path / "scene.toml", tmp_path / "camera.toml", tmp_path / "out"
    scene.write_text(SCENE)
    text = load_camera("paper-clear").text.replace("window_px = 128", "window_px = 24")
    camera.write_text(text.replace("aperture_radius_mm = 2.5", "aperture_radius_mm = 1.0"))
    arguments = ["expose", scene, "--camera", camera, "--out", out, "--cache", tmp_path / "cache"]
    arguments += ["--reference", name, "--crop", "3,5,8,6", "--bands", "2", "--json", out / "figures.json"]
    app([str(each) for each in [*arguments, "--quiet"]], standalone_mode=False)
    reference, photo = (read_image(out / f"{each}.exr") for each in ("reference", "photo"))
    assert reference.shape == (3, 6, 8)
    assert photo.shape == (3, 16, 20)
    assert (out / "reference.png").is_file()
    figures = json.loads((out / "figures.json").read_text())["figures"]
    assert figures["psnr_db.against_reference"] > 27
    assert figures["seconds.reference"] > 0
    error = (photo[:, 5:11, 3:11] - reference).square().mean()
    mirrored = (photo[:, 5:11, 3:11].flip(-1) - reference).square().mean()
    assert error < mirrored / 3
