"""The judge of the network for any camera: which cameras, and what the figures are."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest
from torch import Tensor

from edofsim.core.progress import silent
from edofsim.errors import InputError
from edofsim.experiments import cameras
from edofsim.experiments.camera_figures import ANY, OWN, PHOTO, WIENER, figures_of, table
from edofsim.experiments.cameras import TestedCamera, asked_for, tested_cameras
from edofsim.experiments.failures import Failures
from edofsim.experiments.planes import RANDOM
from edofsim.experiments.protocols import LENS_ALONE
from edofsim.learn.random_cameras import random_camera
from edofsim.optics import Camera
from edofsim.optics.grid import PupilGrid
from edofsim.optics.height import surface
from edofsim.recipe.load import load_camera, load_train
from edofsim.restore.checkpoint import camera_with_mask, trained_camera


def test_gains_are_above_wiener_deconvolution_and_their_means_over_cameras() -> None:
    scores = {
        "one": {RANDOM: {PHOTO: 20.0, WIENER: 24.0, ANY: 27.0}, "desk": {PHOTO: 18, WIENER: 20, ANY: 21}},
        "two": {RANDOM: {PHOTO: 22.0, WIENER: 23.0, ANY: 24.0}, "desk": {PHOTO: 19, WIENER: 20, ANY: 19.5}},
    }
    errors = {"one.desk": {PHOTO: 0.01, ANY: 0.03}}
    figures = figures_of(scores, errors)
    assert figures["psnr_db_se.one.desk.any"] == 0.03
    rows = table(scores, {"one": "first", "two": "second"}, errors).rows
    assert [(row[0], row[-1]) for row in rows] == [("first", None), ("first", 0.03), *[("second", None)] * 2]
    assert figures["psnr_db.one.random.any"] == 27.0 and figures["psnr_db.two.desk.photo"] == 19
    assert figures["gain_db.one.random.any.over_wiener"] == 3.0
    assert figures["gain_db.two.desk.any.over_wiener"] == -0.5
    assert figures["gain_db.mean.random.over_wiener"] == 2.0
    assert figures["gain_db.mean.deep.over_wiener"] == 0.25
    assert figures["gain_db.mean.over_wiener"] == pytest.approx((3 + 1 + 1 - 0.5) / 4)
    assert figures["gain_db.least.over_wiener"] == -0.5 and not any(
        name.startswith("gap_db") for name in figures
    )
    scores["one"][RANDOM][OWN], scores["two"]["desk"][OWN] = 28.25, 19.25
    figures = figures_of(scores)
    assert figures["psnr_db.one.random.own"] == 28.25 and "gap_db.one.desk" not in figures
    assert (figures["gap_db.one.random"], figures["gap_db.two.desk"]) == (1.25, -0.25)
    assert figures["gap_db.greatest"] == 1.25


def heights(camera: Camera) -> Tensor:
    """Of the mask, across the pupil, in metres."""
    made = surface(camera, PupilGrid(101, camera.aperture_radius / 50, camera.aperture_radius))
    assert made is not None
    return made


def test_what_was_trained_for_a_camera_was_trained_for_its_mask() -> None:
    """Lens and focus are the same, and the mask to 10 nm, but for what lifts all of it."""
    own = {tested.name: tested for tested in tested_cameras() if tested.own is not None}
    assert list(own) == ["cubic", "height-map"]
    for tested in own.values():
        checkpoint = tested.own.checkpoint
        trained = camera_with_mask(trained_camera(checkpoint), checkpoint)
        assert tested.camera.recipe.lens == trained.recipe.lens
        assert tested.camera.recipe.focus == trained.recipe.focus
        apart = heights(tested.camera) - heights(trained)
        assert float((apart - apart.mean()).abs().max()) < 1e-8


def test_there_are_six_cameras_and_the_training_drew_none_of_them() -> None:
    every = tested_cameras()
    kinds = [tested.camera.mask.kind for tested in every]
    assert kinds == ["clear", "clear", "cubic", "rings", "height-map", "height-map"]
    assert len({tested.name for tested in every}) == 6
    recipe = load_train("universal").recipe
    assert recipe.cameras is not None
    for number in range(recipe.cameras.count):
        drawn = random_camera(recipe.cameras, recipe.seed, number, 0, recipe.capture.read_noise).camera
        for tested in every:
            same = drawn.recipe.lens == tested.camera.recipe.lens
            assert not (same and drawn.recipe.focus == tested.camera.recipe.focus)


def test_all_three_gains_of_everything_that_is_restored() -> None:
    values = {PHOTO: 20.0, LENS_ALONE: 18.0, WIENER: 24.0, "sharpen": 27.0, OWN: 30.0}
    figures = figures_of({"one": {"desk": values}})
    for what in (WIENER, "sharpen", OWN):
        over = {rival: figures.get(f"gain_db.one.desk.{what}.over_{rival}") for rival in values}
        assert over[PHOTO] == values[what] - 20 and over[LENS_ALONE] == values[what] - 18
        assert over[WIENER] == (None if what == WIENER else values[what] - 24)
    assert figures["gain_db.mean.over_wiener"] == 3.0 and figures["gap_db.one.desk"] == 3.0


@pytest.mark.usefixtures("coarse")
def test_every_kind_of_system_by_its_camera(
    folder: Path, network: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A function with each camera, a network with its own; what fails is named, and the others are there."""
    clear = load_camera("paper-clear").text.replace("window_px = 128", "window_px = 24")
    (tmp_path / "own.toml").write_text(clear.replace('"paper-clear"', '"own"'))
    (tmp_path / "f.py").write_text(
        "def same(photo, psfs, info):\n    return photo\ndef flat(photo, psfs, info):\n    return photo[0]\n"
    )

    def small(name: str, camera: Camera, own: object) -> TestedCamera:
        return TestedCamera(name, name, camera, scenes=(), own=own)

    monkeypatch.setattr(cameras, "_tested", small)
    systems = [f"{tmp_path / 'f.py'}:{name}" for name in ("same", "flat")]
    systems += [str(network), f"{tmp_path / 'own.toml'}+wiener", "nobody"]
    found = cameras.run(tmp_path / "out", silent, folder, 1, [str(tmp_path / "own.toml")], systems)
    figures = found.figures
    own = {what: figures[f"psnr_db.own.random.{what}"] for what in (PHOTO, LENS_ALONE, WIENER, "same")}
    assert own["same"] == pytest.approx(own[PHOTO], abs=0.1)  # the function's image is clamped
    assert own[LENS_ALONE] == pytest.approx(own[PHOTO], abs=1e-9)
    assert figures["gain_db.own.random.same.over_wiener"] == pytest.approx(own["same"] - own[WIENER])
    assert figures["gain_db.trained.random.own.over_photo"] is not None
    assert figures["psnr_db.own+wiener.random.own"] == pytest.approx(own[WIENER])
    assert "psnr_db.own.random.flat" not in figures
    said = "\n".join(found.problems)
    assert said.count("flat: returned the shape") == 1 and "nobody: no such checkpoint" in said
    rows = list(csv.DictReader((tmp_path / "out/cameras-gains.csv").open()))
    row = next(each for each in rows if (each["camera"], each["image"]) == ("own", "same"))
    assert float(row["gain_db_over_wiener"]) == pytest.approx(own["same"] - own[WIENER], abs=1e-3)
    with pytest.raises(InputError, match="nobody: no such") as error:
        cameras.run(tmp_path / "none", silent, folder, 1, None, ["nobody", "else"])
    assert len(error.value.problems) == 2


def test_cameras_are_those_that_are_asked_for() -> None:
    clear, learned = asked_for(["paper-clear", "paper-learned"])
    assert clear.name == "paper-clear" and clear.own is None and clear.camera.mask.kind == "clear"
    assert learned.own is not None and learned.own.name == "paper-bank"
    failures = Failures()
    (only,) = asked_for(["nobody.toml", "paper-clear"], failures)
    assert only.name == "paper-clear" and list(failures.found) == ["nobody.toml"]
    with pytest.raises(InputError, match="more than one is called paper-clear"):
        asked_for(["paper-clear", "paper-learned", "paper-clear"])


def test_a_wide_lens_is_asked_for_pictures_from_a_metre_on() -> None:
    wide, device = asked_for(["lens-50mm-f2", "paper-device"])
    assert (wide.nearest_per_m, wide.scenes) == (1.0, ("hallway",)) and wide.own is None
    assert (device.nearest_per_m, device.scenes) == (2.0, ("desk", "clutter"))
