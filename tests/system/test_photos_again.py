"""`expose` of many scenes goes on from the photos that are there, and takes the members of a family."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch

import edofsim as package
from edofsim.capture import guessed
from edofsim.core.images import read_exr
from edofsim.plan import remember
from edofsim.recipe import load_camera

Run = Callable[..., tuple[int, str]]


def scenes(folder: Path, margin: int = 64) -> list[Path]:
    """Two pictures with depths, of which the second is a family: its scale along the axis varies."""
    rng = np.random.default_rng(0)
    np.save(folder / "a.npy", rng.integers(0, 256, (48, 64, 3), dtype=np.uint8))
    np.save(folder / "z.npy", np.full((48, 64), 1.2))
    text = (
        f'[frame]\nwidth_px = 64\nheight_px = 48\nmargin_px = {margin}\npixel_angle_mrad = "auto"\n'
        '[source]\nkind = "rgbd"\nimage = "a.npy"\n[source.depth]\npath = "z.npy"\nscale = 1.0\n'
    )
    family = '[[family.vary]]\nkey = "source.depth.scale"\nuniform = [1.0, 2.0]\n'
    for name, more in (("one", ""), ("many", family)):
        (folder / f"{name}.toml").write_text(f'name = "{name}"\n{text}{more}')
    return [folder / "one.toml", folder / "many.toml"]


def cubic_of(folder: Path) -> Path:
    """The shipped camera with a window for scenes with a margin of 24."""
    path = folder / "paper-cubic.toml"
    path.write_text(load_camera("paper-cubic").text.replace("window_px = 128", "window_px = 48"))
    return path


def photos(folder: Path) -> dict[str, int]:
    return {path.parent.name: path.stat().st_mtime_ns for path in folder.glob("*/photo.exr")}


def test_photos_that_are_there_stay_and_those_that_changed_are_taken_again(edofsim: Run, tmp_path: Path):
    made, out = scenes(tmp_path, 24), tmp_path / "out"
    command = ("expose", *made, "--camera", cubic_of(tmp_path), "--accuracy", "20dB", "--out", out)
    assert edofsim(*command)[0] == 0
    first = photos(out)
    assert len(first) == 2
    assert edofsim(*command)[0] == 0
    assert photos(out) == first
    (out / "one-paper-cubic" / "photo.png").write_bytes(b"cut")
    assert edofsim(*command)[0] == 0
    second = photos(out)
    assert second["one-paper-cubic"] > first["one-paper-cubic"]
    assert second["many-paper-cubic"] == first["many-paper-cubic"]
    np.save(tmp_path / "z.npy", np.full((48, 64), 0.7))  # a file that both recipes name
    assert edofsim(*command)[0] == 0
    third = photos(out)
    assert all(third[name] > second[name] for name in second)
    assert edofsim(*command, "--seed", "3")[0] == 0
    assert all(when > third[name] for name, when in photos(out).items())


def test_what_a_plan_guessed_is_photographed(edofsim: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Behind a disc of paper: guessed once, for both. What is remembered serves the second time, although
    the layers that are insisted on are labelled as the plan's own."""
    one, guesses, found = scenes(tmp_path)[0], [], guessed._found
    depth = np.full((48, 64), 1.6)
    depth[12:36, 20:44] = 0.6
    np.save(tmp_path / "z.npy", depth)
    monkeypatch.setattr(guessed, "_found", lambda *given: guesses.append(given) or found(*given))
    command = ("expose", one, "--camera", "paper-clear", "--sub-apertures", "1", "--layers", "2")
    monkeypatch.setattr(remember, "_folder", lambda: tmp_path / "plans")
    for again in range(2):
        assert edofsim(*command, "--out", tmp_path / str(again))[0] == 0
        assert len(guesses) == 1 + again
    assert list((tmp_path / "plans").iterdir())


@pytest.mark.usefixtures("plots_left_out")
def test_both_photos_of_a_run_share_one_guess(edofsim: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """With the mask and without, and the plans of both; its seconds are none of the plan's."""
    one, seconds, found = scenes(tmp_path, 24)[0], [], guessed._found
    depth = np.full((48, 64), 1.6)
    depth[12:36, 20:44] = 0.6
    np.save(tmp_path / "z.npy", depth)

    def timed(*given):
        start = time.perf_counter()
        known = found(*given)
        seconds.append(time.perf_counter() - start)
        return known

    monkeypatch.setattr(guessed, "_found", timed)
    told = tmp_path / "run.json"
    options = ("--camera", cubic_of(tmp_path), "--accuracy", "40dB", "--network", "wiener")
    options += ("--out", tmp_path / "run", "--json", told)
    status, said = edofsim("run", one, *options)
    assert status == 0, said
    assert len(seconds) == 1
    assert json.loads(told.read_text())["figures"]["seconds.guess"] >= seconds[0]


def test_members_of_a_family_are_photographed_and_seen_in_python(edofsim: Run, tmp_path: Path):
    many, out = scenes(tmp_path, 24)[1], tmp_path / "out"
    command = (
        "expose",
        many,
        "--members",
        "3",
        "--camera",
        cubic_of(tmp_path),
        "--accuracy",
        "20dB",
        "--out",
        out,
    )
    assert edofsim(*command)[0] == 0
    names = sorted(photos(out))
    assert len(names) == 3
    planes = [read_exr(out / name / "photo.exr", "photo")["clean.G"] for name in names]
    assert not any(np.array_equal(planes[0], other) for other in planes[1:])
    seen = [float(1 / view.inverse_depth[0]) for view in package.views(many, members=3)]
    assert len(set(seen)) == 3 and all(1.19 <= depth <= 2.41 for depth in seen)


def test_a_scene_without_a_family_has_no_members(edofsim: Run, tmp_path: Path):
    status, said = edofsim("expose", scenes(tmp_path)[0], "--members", "2", "--out", tmp_path / "out")
    assert status == 2 and "family" in said
    with pytest.raises(package.InputError, match="family"):
        list(package.views(tmp_path / "one.toml", members=2))


def test_a_photo_and_a_view_come_back_from_their_files(edofsim: Run, tmp_path: Path):
    one = scenes(tmp_path)[0]
    command = ("expose", one, "--camera", "paper-cubic", "--accuracy", "20dB", "--out", tmp_path / "out")
    assert edofsim(*command)[0] == 0
    photo = package.Photo.load(tmp_path / "out" / "photo.exr")
    assert photo.how.scene == "one" and photo.how.camera["mask"]["kind"] == "cubic"
    assert len(photo.how.view) == 64
    assert photo.inverse_depth is not None and photo.inverse_depth.shape == photo.image.shape[1:]
    np.testing.assert_allclose(photo.inverse_depth, 1 / 1.2, rtol=1e-6)  # what scenes() put there
    again = package.Photo.load(photo.save(tmp_path / "again.exr"))
    for name in ("image", "clean", "ideal", "truncated", "inverse_depth"):
        assert np.array_equal(getattr(again, name), getattr(photo, name)), name
    assert again.how == photo.how and again.exposure == photo.exposure

    view = package.view(one, package.camera("paper-cubic"))
    saved = package.View.load(view.save(tmp_path / "view.exr"))
    assert np.array_equal(saved.pixel, view.pixel) and np.array_equal(saved.wavelengths, view.wavelengths)
    np.testing.assert_allclose(saved.radiance, view.radiance, rtol=2**-11, atol=1e-6)  # half floats
    np.testing.assert_allclose(saved.inverse_depth, view.inverse_depth, rtol=1e-6)
    assert (saved.margin, saved.pixel_angle) == (view.margin, view.pixel_angle)


def test_files_that_are_no_photo_and_no_view_are_refused(tmp_path: Path):
    plain = package.save_image(tmp_path / "plain.exr", torch.full((3, 8, 8), 0.5))
    for load in (package.Photo.load, package.View.load):
        with pytest.raises(package.InputError, match="plain.exr"):
            load(plain)
        with pytest.raises(package.InputError, match="none.exr"):
            load(tmp_path / "none.exr")
    with pytest.raises(package.InputError, match=r"\.exr"):
        package.View.flat(torch.ones(1, 4, 4), 1.0, wavelengths=[5e-7], pixel_angle=1e-4).save("view.png")
