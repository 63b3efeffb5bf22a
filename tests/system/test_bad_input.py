"""Whatever a user gives wrongly ends in one readable message and exit status 2, before time is spent."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from edofsim.experiments.restorations import AsItIs, ByWiener
from edofsim.recipe import load_camera

SCENE = """\
name = "small"

[bands]
start_nm = 540
stop_nm = 560
count = 2

[frame]
width_px = 24
height_px = 16
margin_px = 4

[render]
samples = 4

[[objects]]
kind = "panel"
name = "card"
width_mm = 20
height_mm = 20
depth_m = 1.0
surface = { kind = "matt" }

[[lights]]
kind = "sky"
"""

Run = Callable[..., tuple[int, str]]


def scene_file(folder: Path, text: str) -> Path:
    path = folder / "scene.toml"
    path.write_text(text)
    return path


def camera_file(folder: Path, old: str, new: str) -> Path:
    """The shipped cubic camera with one line changed."""
    path = folder / "camera.toml"
    text = load_camera("paper-cubic").text
    assert old in text
    path.write_text(text.replace(old, new))
    return path


def refused(result: tuple[int, str], *words: str) -> None:
    status, said = result
    assert status == 2, said
    assert "Traceback" not in said
    for word in words:
        assert word in said


def test_a_missing_file(edofsim: Run, tmp_path: Path):
    refused(edofsim("run", tmp_path / "none.toml"), "none.toml", "no such file")


def test_toml_syntax(edofsim: Run, tmp_path: Path):
    path = scene_file(tmp_path, SCENE.replace("count = 2", "count = "))
    refused(edofsim("run", path), "scene.toml", "not valid TOML", "line 6")


def test_an_unknown_key(edofsim: Run, tmp_path: Path):
    path = scene_file(tmp_path, SCENE.replace("samples", "sampels"))
    refused(edofsim("run", path), "sampels", "samples", "line 14")


def test_two_mistakes_at_once(edofsim: Run, tmp_path: Path):
    text = SCENE.replace("width_mm = 20", "width_mm = -20").replace("samples = 4", "samples = 0")
    refused(edofsim("run", scene_file(tmp_path, text)), "width_mm", "samples", "-20")


def test_mistakes_in_scene_and_camera_are_both_named(edofsim: Run, tmp_path: Path):
    scene = scene_file(tmp_path, SCENE.replace("samples = 4", "samples = 0"))
    refused(edofsim("run", scene, "--camera", tmp_path / "none.toml"), "samples", "none.toml")


@pytest.mark.usefixtures("workers_here")
def test_a_texture_that_is_not_an_image(edofsim: Run, tmp_path: Path):
    (tmp_path / "picture.png").write_text("this is no picture")
    surface = 'surface = { kind = "matt", texture = { kind = "file", path = "picture.png" } }'
    text = SCENE.replace('surface = { kind = "matt" }', surface)
    refused(
        edofsim("render", scene_file(tmp_path, text), "--cache", tmp_path / "cache"), "picture.png", "card"
    )


def test_a_mesh_with_nan_vertices(edofsim: Run, tmp_path: Path):
    (tmp_path / "mesh.obj").write_text("v 0 0 0\nv 1 0 0\nv nan 1 0\nf 1 2 3\n")
    text = (
        SCENE
        + '\n[[objects]]\nkind = "mesh"\nname = "broken"\npath = "mesh.obj"\nsize_mm = 20\ndepth_m = 1.0\n'
    )
    refused(
        edofsim("render", scene_file(tmp_path, text), "--cache", tmp_path / "cache"), "mesh.obj", "vertices"
    )


def test_an_object_behind_the_camera(edofsim: Run, tmp_path: Path):
    text = SCENE.replace("depth_m = 1.0", "depth_m = -1.0")
    refused(edofsim("render", scene_file(tmp_path, text), "--cache", tmp_path / "cache"), "card", "behind")


def test_a_camera_that_cannot_focus(edofsim: Run, tmp_path: Path):
    """36 mm of focal length cannot image an object at 30 mm onto any sensor."""
    camera = camera_file(tmp_path, "distance_m = 1.5", "distance_m = 0.03")
    refused(edofsim("run", scene_file(tmp_path, SCENE), "--camera", camera), "0.03", "focus")


def test_a_wavelength_outside_the_glass_data(edofsim: Run, tmp_path: Path):
    camera = camera_file(tmp_path, "wavelength_nm = 587.6", "wavelength_nm = 5876.0")
    refused(edofsim("run", scene_file(tmp_path, SCENE), "--camera", camera), "5876", "nm")


@pytest.mark.parametrize("command", ["run", "expose"])
def test_an_unwritable_output_folder(edofsim: Run, tmp_path: Path, command: str):
    (tmp_path / "file").touch()
    refused(
        edofsim(command, scene_file(tmp_path, SCENE), "--out", tmp_path / "file" / "below"), "file", "--out"
    )


def test_a_wrong_option_and_a_missing_argument(edofsim: Run):
    for arguments in (["run", "--no-such-option"], ["expose"], ["run", "desk", "--device", "tpu"]):
        refused(edofsim(*arguments), "--help")


def test_a_photo_that_cannot_be_read(edofsim: Run, tmp_path: Path):
    refused(edofsim("restore", tmp_path / "none.exr"), "none.exr")
    (tmp_path / "broken.exr").write_bytes(b"\x76\x2f\x31\x01" + b"\0" * 40)
    refused(edofsim("restore", tmp_path / "broken.exr", "--out", tmp_path), "broken.exr")


def test_depths_that_make_no_range(edofsim: Run, tmp_path: Path):
    np.save(tmp_path / "x.npy", np.zeros(3))
    refused(edofsim("restore", tmp_path / "x.npy", "--near", "2", "--far", "1"), "--near", "--far")


def test_a_damaged_cache_entry_is_rendered_again_and_kept_aside(edofsim: Run, tmp_path: Path):
    scene, cache = scene_file(tmp_path, SCENE), tmp_path / "cache"
    arguments = ("render", scene, "--cache", cache, "--quiet")
    assert edofsim(*arguments)[0] == 0
    written = {path: path.read_bytes() for path in cache.rglob("*") if path.is_file()}
    largest = max(written, key=lambda path: len(written[path]))
    damaged = bytearray(written[largest])
    damaged[len(damaged) // 2] ^= 0xFF
    largest.write_bytes(bytes(damaged))
    status, said = edofsim(*arguments)
    assert status == 0 and "damaged" in said
    assert largest.read_bytes() == written[largest]
    assert any("damaged" in path.name and path.read_bytes() == bytes(damaged) for path in cache.rglob("*"))


def test_a_reference_that_cannot_be_made(edofsim: Run, tmp_path: Path):
    text = SCENE.replace("start_nm = 540", "start_nm = 430").replace("stop_nm = 560", "stop_nm = 700")
    scene = scene_file(tmp_path, text.replace("count = 2", "count = 4"))
    base = ("expose", scene, "--out", tmp_path / "out", "--cache", tmp_path / "cache", "--quiet")
    refused(edofsim(*base, "--reference", "pupil"), "--crop", "--reference")
    refused(edofsim(*base, "--crop", "0,0,4,4"), "--crop", "--reference")
    refused(edofsim(*base, "--reference", "pupil", "--crop", "4,4"), "X,Y,WIDTH,HEIGHT")
    refused(edofsim(*base, "--reference", "wave", "--crop", "0,0,4,4"), "wave", "thinlens, pupil")
    refused(edofsim(*base, "--reference", "thinlens", "--crop", "0,0,4,4"), "mask", "pupil", "paper-clear")
    refused(edofsim("evaluate", "occlusion", "no-such-scene", "--out", tmp_path / "out"), "no-such-scene")
    assert not (tmp_path / "cache").exists()  # nothing was rendered
    refused(
        edofsim(*base, "--reference", "pupil", "--crop", "20,0,8,8"), "frame of 24 x 16", "X,Y,WIDTH,HEIGHT"
    )
    refused(edofsim(*base, "--bands", "9"), "--bands 9", "1 to 4")


JOBS = {
    "run": ["run", "SCENE"],
    "render": ["render", "SCENE"],
    "expose": ["expose", "SCENE"],
    "plan": ["plan", "SCENE"],
    "cost": ["cost", "SCENE"],
    "restore": ["restore", "photo.png"],
    "train": ["train", "paper-dcnn"],
    "psf": ["psf"],
    "cache": ["cache", "ls"],
    "evaluate": ["evaluate", "stability"],
}


@pytest.mark.parametrize("job", JOBS)
def test_figures_that_cannot_be_written_are_refused_before_the_work(
    edofsim: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, job: str
):
    (tmp_path / "file").touch()
    scene = scene_file(tmp_path, SCENE)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("EDOFSIM_CACHE", str(tmp_path / "cache"))
    line = [scene if word == "SCENE" else word for word in JOBS[job]]
    for place in (tmp_path / "file" / "below" / "x.json", tmp_path):
        refused(edofsim(*line, "--json", place), str(place), "--json")
    assert not (tmp_path / "cache").exists()


@pytest.mark.parametrize("command", ["run", "expose", "plan"])
def test_effects_that_cannot_be_simulated_or_left_out(edofsim: Run, tmp_path: Path, command: str):
    base = (command, scene_file(tmp_path, SCENE), "--cache", tmp_path / "cache")
    refused(edofsim(*base, "--with", "exact lense"), "'exact lense'", "exact lens")
    refused(edofsim(*base, "--without", "glare"), "'glare' is not known")
    both = ("--with", "occlusion", "--without", "occlusion")
    refused(edofsim(*base, *both), "--with and --without 'occlusion'")
    both = ("--with", "psf-window", "--without", "PSF window")  # as shells complete it, and as pages have it
    refused(edofsim(*base, *both), "--with and --without 'PSF window'")
    assert not (tmp_path / "cache").exists()


@pytest.mark.parametrize("command", ["run", "expose"])
def test_numbers_beyond_all_reason(edofsim: Run, tmp_path: Path, command: str):
    base = (command, scene_file(tmp_path, SCENE), "--cache", tmp_path / "cache")
    refused(edofsim(*base, "--layers", 1_000_000_000), "--layers", "4096")
    refused(edofsim(*base, "--seed", 2**64), "--seed", str(2**64 - 1))
    refused(edofsim(*base, "--seed", -1), "--seed")
    refused(edofsim(*base, "--occlusion", "some"), "'some' is not known", "normalised")
    refused(edofsim(*base, "--method", "fast"), "no --method fast any more", "leave it out")
    refused(edofsim(*base, "--method", "low_rank"), "any more", "bands in groups")
    refused(edofsim(*base, "--pupil-parts", 2, "--occlusion", "over"), "hidden", "'over'")
    assert not (tmp_path / "cache").exists()


@pytest.mark.usefixtures("plots_left_out")
def test_the_largest_seed_is_one(edofsim: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """64 bits, everywhere that a seed goes: restorations have none."""
    monkeypatch.setattr(ByWiener, "__call__", AsItIs.__call__)
    largest, where = str(2**64 - 1), ("--out", tmp_path / "out", "--quiet")
    small = Path(__file__).parents[1] / "small"
    line = ("expose", small / "small.toml", "--camera", small / "camera.toml", "--seed", largest)
    status, said = edofsim(*line, "--cache", tmp_path / "cache", *where)
    assert status == 0, said
    Image.fromarray(np.full((192, 192, 3), 99, np.uint8)).save(tmp_path / "grey.png")
    line = ("evaluate", "noise", "--data", tmp_path, "--network", "paper-clear", "--seed", largest)
    status, said = edofsim(*line, *where)
    assert status == 0, said


def test_depths_and_wavelengths_of_a_psf(edofsim: Run, tmp_path: Path):
    base = ("psf", "paper-clear", "--out", tmp_path / "out", "--quiet")
    refused(edofsim(*base, "--depths", "0.5,near"), "--depths", "0.5,1,inf")
    refused(edofsim(*base, "--depths", "0,1"), "--depths", "above 0")
    refused(edofsim(*base, "--wavelengths", "-5"), "--wavelengths", "nanometres")
    refused(edofsim(*base, "--fields", "0,95"), "--fields", "from 0 to 90")
    refused(edofsim(*base, "--frequency", "0"), "--frequency", "above 0")
    refused(edofsim(*base, "--fields", "0,5"), "--fields", "the same over the field")


def test_benchmarks_without_the_source_checkout(
    edofsim: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setitem(sys.modules, "benchmarks", None)
    refused(edofsim("evaluate", "bench", "--out", tmp_path, "--quiet"), "source checkout")
