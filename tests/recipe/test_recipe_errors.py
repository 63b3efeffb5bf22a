"""A recipe with mistakes is refused with every mistake named, its line, and the nearest known word."""

from __future__ import annotations

import os
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from edofsim.errors import InputError
from edofsim.recipe.load import load_camera, load_scene
from edofsim.recipe.toml import line_numbers

GOOD = """\
name = "small"
seed = 3

[frame]
width_px = 32
height_px = 24

[[objects]]
kind = "sphere"
name = "ball"
radius_mm = 5.0
depth_m = 0.6

[[objects]]
kind = "panel"
width_mm = 10
height_mm = 10
depth_m = 1.0
surface = { kind = "plastic", roughness = 0.2 }
"""


def problems(tmp_path: Path, text: str) -> tuple[str, ...]:
    path = tmp_path / "scene.toml"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        load_scene(path)
    return caught.value.problems


def test_the_good_recipe_loads(tmp_path: Path):
    path = tmp_path / "scene.toml"
    path.write_text(GOOD)
    loaded = load_scene(path)
    assert loaded.recipe.objects[0].radius_mm == 5.0 and loaded.base == tmp_path


def test_an_unknown_key_is_named_with_its_line_and_the_nearest_known_one(tmp_path: Path):
    (only,) = problems(tmp_path, GOOD.replace("width_px = 32", "widht_px = 32"))
    assert "line 5" in only and "'frame.widht_px'" in only and "did you mean 'width_px'" in only


def test_an_unknown_key_in_an_object_is_compared_with_that_objects_keys(tmp_path: Path):
    (only,) = problems(tmp_path, GOOD.replace("radius_mm = 5.0", "radius_mm = 5.0\nradios_mm = 6.0"))
    assert "line 12" in only and "did you mean 'radius_mm'" in only


def test_an_unknown_key_inside_an_inline_table_has_its_line(tmp_path: Path):
    (only,) = problems(tmp_path, GOOD.replace("roughness = 0.2", "roughnes = 0.2"))
    assert "line 19" in only and "did you mean 'roughness'" in only


def test_a_negative_radius(tmp_path: Path):
    (only,) = problems(tmp_path, GOOD.replace("radius_mm = 5.0", "radius_mm = -5.0"))
    assert "line 11" in only and "radius_mm" in only and "greater than 0" in only and "-5.0" in only


def test_two_mistakes_are_both_named(tmp_path: Path):
    both = GOOD.replace("radius_mm = 5.0", "radius_mm = -5.0").replace("height_px = 24", 'height_px = "tall"')
    found = problems(tmp_path, both)
    assert len(found) == 2 and "height_px" in found[0] and "radius_mm" in found[1]


def test_an_unknown_kind_lists_the_known_ones(tmp_path: Path):
    (only,) = problems(tmp_path, GOOD.replace('"sphere"', '"shpere"'))
    assert "line 8" in only or "line 9" in only
    assert "did you mean 'sphere'" in only and "panel" in only


def test_a_missing_key_is_named(tmp_path: Path):
    (only,) = problems(tmp_path, GOOD.replace("radius_mm = 5.0\n", ""))
    assert "'objects.0.radius_mm' is missing" in only and "line 8" in only


@pytest.mark.parametrize("value", ["nan", "inf", "-inf"])
def test_numbers_that_are_not_finite_are_refused(tmp_path: Path, value: str):
    (only,) = problems(tmp_path, GOOD.replace("radius_mm = 5.0", f"radius_mm = {value}"))
    assert "radius_mm" in only


def test_toml_syntax_has_its_place(tmp_path: Path):
    (only,) = problems(tmp_path, GOOD.replace("seed = 3", "seed = "))
    assert "not valid TOML" in only and "line 2" in only


@pytest.mark.parametrize("text", ["[" * 5000, "a = " + "[" * 100_000], ids=["headers", "arrays"])
def test_deep_nesting_is_refused(tmp_path: Path, text: str):
    (only,) = problems(tmp_path, text)
    assert "not valid TOML" in only


def test_bytes_that_are_not_text(tmp_path: Path):
    path = tmp_path / "scene.toml"
    path.write_bytes(b"name = \xff\xfe")
    with pytest.raises(InputError, match="not UTF-8"):
        load_scene(path)


def test_a_missing_file_and_a_misspelt_shipped_name(tmp_path: Path):
    with pytest.raises(InputError, match="no such file"):
        load_scene(tmp_path / "none.toml")
    with pytest.raises(InputError, match="did you mean 'desk'"):
        load_scene("deks")


def test_a_folder_is_not_a_recipe(tmp_path: Path):
    with pytest.raises(InputError, match="is a folder"):
        load_scene(tmp_path)


def test_lines_are_those_of_the_file():
    """Each location that the scanner finds exists in what tomllib parses, on a line that mentions it."""
    lines = line_numbers(GOOD)
    data = tomllib.loads(GOOD)
    for location, number in lines.items():
        value = data
        for part in location:
            value = value[part]
        if isinstance(location[-1], str):
            assert location[-1] in GOOD.splitlines()[number - 1]


def test_the_command_ends_in_one_message_and_status_2(tmp_path: Path):
    path = tmp_path / "scene.toml"
    path.write_text(GOOD.replace("radius_mm = 5.0", "radius_mm = -5.0"))
    done = subprocess.run(
        [sys.executable, "-m", "edofsim", "render", str(path)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    assert "radius_mm" in done.stderr and "Traceback" not in done.stderr


def test_a_value_that_is_nothing_that_it_may_be_is_told_once(tmp_path: Path):
    (only,) = problems(tmp_path, GOOD.replace("roughness = 0.2", "reflectance = [0.1]"))
    assert only.endswith("objects.1.surface.reflectance must be a valid number or a valid string, not [0.1]")


def test_one_mistake_in_thousands_of_objects_ends_in_a_message_that_can_be_read(tmp_path: Path):
    path = tmp_path / "scene.toml"
    path.write_text('name = "many"\n' + '[[objects]]\nkind = "sphere"\nradios_mm = 1\n' * 1000)
    command = [sys.executable, "-m", "edofsim", "render", str(path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) < 100 and "more like these" in done.stderr


def test_a_byte_order_mark_and_windows_line_ends(tmp_path: Path):
    path = tmp_path / "scene.toml"
    path.write_bytes(b"\xef\xbb\xbf" + GOOD.replace("\n", "\r\n").encode())
    assert load_scene(path).recipe.frame.width_px == 32


def test_an_unknown_key_lists_what_is_allowed(tmp_path: Path):
    (only,) = problems(tmp_path, GOOD.replace("width_px = 32", "zoom = 32"))
    assert only.endswith("known: height_px, margin_px, pixel_angle_mrad, width_px")


@pytest.mark.parametrize("value", ["true", '"32"'])
def test_only_numbers_are_numbers(tmp_path: Path, value: str):
    (only,) = problems(tmp_path, GOOD.replace("width_px = 32", f"width_px = {value}"))
    assert "line 5: frame.width_px must be a number, not" in only
    (only,) = problems(tmp_path, GOOD.replace("radius_mm = 5.0", f"radius_mm = {value}"))
    assert "objects.0.radius_mm must be a number" in only
    (only,) = problems(tmp_path, GOOD.replace("roughness = 0.2", f"roughness = {value}"))
    assert "objects.1.surface.roughness must be a number" in only


@pytest.mark.parametrize("digits", [400, 5000])
def test_numbers_of_many_digits(tmp_path: Path, digits: int):
    (only,) = problems(tmp_path, GOOD.replace("radius_mm = 5.0", "radius_mm = " + "9" * digits))
    assert len(only) < 300 and str(tmp_path) in only


def test_a_wrong_term_of_a_mask_is_named(tmp_path: Path):
    path = tmp_path / "camera.toml"
    path.write_text('name = "own"\n[mask]\nkind = "zernike"\nterms = [{ noll = 0, rms_rad = 1.0 }]\n')
    with pytest.raises(InputError) as caught:
        load_camera(path)
    (only,) = caught.value.problems
    assert "line 4: mask.terms.0.noll must be greater than or equal to 1, not 0" in only


def test_what_is_no_ordinary_file_is_not_read(tmp_path: Path):
    os.mkfifo(tmp_path / "scene.toml")
    for path in (tmp_path / "scene.toml", Path("/dev/zero"), Path("/dev/full")):
        with pytest.raises(InputError, match="a device or a pipe"):
            load_scene(path)
    grown = tmp_path / "large.toml"
    grown.write_bytes(b"#" * (2 << 20))
    with pytest.raises(InputError, match="larger than 1 MiB"):
        load_scene(grown)
