"""Lists of scenes: looked through before anything is rendered, and what is done of them is kept and shown."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from skimage.io import imread, imsave

from edofsim.core.images import srgb_decode
from edofsim.errors import EdofsimError
from edofsim.render import spread

Run = Callable[..., tuple[int, str]]

FRAME = (
    "[frame]\nwidth_px = 12\nheight_px = 8\nmargin_px = 2\n"
    "[bands]\ncount = 3\nstart_nm = 480\nstop_nm = 600\n"
)
PANEL = (
    '[[objects]]\nkind = "panel"\nwidth_mm = 20\nheight_mm = 20\ndepth_m = 1.0\n[[lights]]\nkind = "sky"\n'
)
CUBE = '[source]\nkind = "cube"\npath = "cube"\ndepth_m = 1.0\n'
RGBD = '[source]\nkind = "rgbd"\nimage = "a.png"\n[source.depth]\npath = "z.npy"\n'


@pytest.fixture
def scenes(tmp_path: Path) -> Callable[..., Path]:
    (tmp_path / "cube").mkdir()
    for band in range(3):
        imsave(tmp_path / "cube" / f"{band}.png", np.full((16, 20), 90, np.uint8), check_contrast=False)
    imsave(tmp_path / "a.png", np.full((16, 20, 3), 90, np.uint8), check_contrast=False)
    np.save(tmp_path / "z.npy", np.full((16, 20), 2.0))

    def write(name: str, body: str, more: str = "") -> Path:
        path = tmp_path / f"{name}.toml"
        path.write_text(f'name = "{name}"\n{FRAME}[render]\nsamples = 2\n{body}{more}')
        return path

    return write


def test_a_cube_without_wavelengths_is_found_before_anything_is_rendered(
    edofsim: Run, scenes, tmp_path: Path
):
    status, said = edofsim("render", scenes("panel", PANEL), scenes("cube", CUBE), "--cache", tmp_path / "c")
    assert status == 2 and "start_nm and step_nm" in said and "to render" not in said
    assert not list((tmp_path / "c").glob("*.exr"))


@pytest.mark.usefixtures("plots_left_out")
def test_a_view_is_resampled_for_another_camera_on_request_alone(edofsim: Run, tmp_path: Path):
    """A scene of 48 x 32 pixels of half the camera's angle: refused before anything is rendered, with the
    option that helps; with it, a photo of 24 x 16 pixels, as of the same scene seen by its pixels."""
    from edofsim.capture import read_image

    angle = 6 / 36.8975  # mrad, of the shipped cameras
    scene = (
        "[render]\nsamples = 32\n[bands]\ncount = 3\nstart_nm = 480\nstop_nm = 600\n"
        '[[lights]]\nkind = "sky"\n[[objects]]\nkind = "wall"\ndepth_m = 1.6\n'
        'surface = { kind = "matt", texture = { kind = "photo", name = "coffee" } }\n'
        '[[objects]]\nkind = "panel"\ndepth_m = 1.4\nx_frame = -0.5\nwidth_mm = 2\nheight_mm = 2\n'
    )
    paths = {}
    (tmp_path / "narrow.toml").write_text('name = "narrow"\n[psf]\nwindow_px = 32\n')  # of shipped pixels
    for name, factor in (("own", 1), ("finer", 2)):
        size = f"width_px = {24 * factor}\nheight_px = {16 * factor}\nmargin_px = {16 * factor}\n"
        paths[name] = tmp_path / f"{name}.toml"
        text = f'name = "{name}"\ncamera = "narrow.toml"\n[frame]\n{size}'
        paths[name].write_text(f"{text}pixel_angle_mrad = {angle / factor}\n{scene}")
    cache = ("--cache", tmp_path / "c")
    for command in ("run", "expose", "plan", "cost"):
        status, said = edofsim(command, paths["finer"], *cache, "--quiet")
        assert status == 2 and "resample its view (--resample)" in " ".join(said.split())
    assert not (tmp_path / "c").exists()
    photos = {}
    for name, path in paths.items():
        status, said = edofsim(
            "expose", path, *cache, "--resample", "--accuracy", "full", "--out", tmp_path / name, "--quiet"
        )
        assert status == 0, said
        photos[name] = read_image(tmp_path / name / "photo.exr")
    assert photos["own"].shape == photos["finer"].shape == (3, 16, 24)
    own, finer = (photo / photo.mean() for photo in photos.values())
    # the sensor's noise of half a per cent, twice, and those of 32 and 128 samples a pixel; contrast is 15 %
    assert float((own - finer).square().mean().sqrt()) < 0.01
    for command in (("plan",), ("run", "--network", "wiener", "--out", tmp_path / "run")):
        status, said = edofsim(*command, paths["finer"], *cache, "--resample", "--quiet")
        assert status == 0, said


@pytest.mark.usefixtures("workers_here")
def test_pictures_of_views_that_are_read(edofsim: Run, scenes, tmp_path: Path):
    cube = scenes("cube", CUBE, "start_nm = 480\nstep_nm = 60\n")
    status, said = edofsim(
        "render", cube, scenes("rgbd", RGBD), "--cache", tmp_path / "c", "--out", tmp_path / "o"
    )
    assert status == 0 and "2 read from pictures; nothing to render" in said
    names = {"cube.png", "cube-depth.png", "rgbd.png", "rgbd-depth.png"}
    assert names == {path.name for path in (tmp_path / "o").iterdir()}


@pytest.mark.usefixtures("plots_left_out")
def test_a_picture_is_also_shown_in_the_colours_that_were_given(edofsim: Run, tmp_path: Path):
    """The sensor's own colours are others: it shows them only where it is asked to."""
    given = np.zeros((128, 160, 3), np.uint8)
    given[:, :80], given[:, 80:] = (170, 110, 80), (90, 120, 150)
    given[80:] = 235  # white, which the exposure goes by
    imsave(tmp_path / "a.png", given, check_contrast=False)
    np.save(tmp_path / "z.npy", np.full((128, 160), 2.0))
    frame = "[frame]\nwidth_px = 160\nheight_px = 128\nmargin_px = 0\n"
    scene = tmp_path / "two.toml"
    scene.write_text(f'name = "two"\n{frame}{RGBD}')
    commands = (("expose",), ("run", "--network", "wiener"), ("expose", "--raw-colours"))
    for command in commands:
        out = tmp_path / command[-1]
        status, said = edofsim(*command[:1], scene, *command[1:], "--out", out, "--cache", tmp_path / "c")
        assert status == 0, said
        shown, ideal = (imread(out / f"{name}.png").astype(int) for name in ("given", "ideal"))
        assert shown.shape == given.shape and np.abs(shown - given).max() <= 2
        hues = [srgb_decode(each[64] / 255) for each in (ideal, given)]
        hues = [each / each.sum(-1, keepdims=True) for each in hues]
        assert (np.abs(hues[0] - hues[1]).max() > 0.05) == ("--raw-colours" in command)


@pytest.mark.usefixtures("workers_here")
def test_what_is_done_of_a_list_is_shown_when_one_fails(
    edofsim: Run, scenes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    real = spread.Workers._result

    def lost(self, number, future):
        outcome = real(self, number, future)
        return self.failed(number, EdofsimError(spread.LOST)) if number == 1 else outcome

    monkeypatch.setattr(spread.Workers, "_result", lost)
    paths = [scenes("first", PANEL), scenes("second", PANEL), scenes("third", RGBD)]
    status, said = edofsim(
        "render", *paths, "--cache", tmp_path / "c", "--out", tmp_path / "o", "--json", tmp_path / "r.json"
    )
    assert status == 1 and "second: its worker died" in said
    assert {"first.png", "third.png"} <= {path.name for path in (tmp_path / "o").iterdir()}
    figures = json.loads((tmp_path / "r.json").read_text())["figures"]
    assert figures["views"] == 2 and "seconds.first" in figures and "seconds.second" not in figures


def test_a_camera_of_other_pixels_is_found_first(edofsim: Run, scenes, tmp_path: Path):
    path = scenes("fixed", PANEL)
    path.write_text(path.read_text().replace("[frame]\n", "[frame]\npixel_angle_mrad = 0.4\n"))
    status, said = edofsim("run", path, "--cache", tmp_path / "c", "--out", tmp_path / "o")
    assert status == 2 and "sees 0.4 mrad" in said and '"auto"' in said
    assert not (tmp_path / "c").exists()
