"""The judge of the network for any camera: which cameras, and what the figures are."""

from __future__ import annotations

import pytest

from edofsim.errors import InputError
from edofsim.experiments import cameras
from edofsim.experiments.cameras import ANY, PHOTO, WIENER, figures_of, takers
from edofsim.experiments.planes import RANDOM
from edofsim.learn.random_cameras import random_camera
from edofsim.recipe.load import load_train


def test_gains_are_above_wiener_deconvolution_and_their_means_over_cameras() -> None:
    scores = {
        "one": {RANDOM: {PHOTO: 20.0, WIENER: 24.0, ANY: 27.0}, "desk": {PHOTO: 18, WIENER: 20, ANY: 21}},
        "two": {RANDOM: {PHOTO: 22.0, WIENER: 23.0, ANY: 24.0}, "desk": {PHOTO: 19, WIENER: 20, ANY: 19.5}},
    }
    figures = figures_of(scores)
    assert figures["psnr_db.one.random.any"] == 27.0 and figures["psnr_db.two.desk.photo"] == 19
    assert figures["gain_db.one.random"] == 3.0 and figures["gain_db.two.desk"] == -0.5
    assert figures["gain_db.mean.random"] == 2.0 and figures["gain_db.mean.deep"] == 0.25
    assert figures["gain_db.mean"] == pytest.approx((3 + 1 + 1 - 0.5) / 4)
    assert figures["gain_db.least"] == -0.5


def test_there_are_six_cameras_and_the_training_drew_none_of_them() -> None:
    every = takers()
    kinds = [taker.camera.mask.kind for taker in every]
    assert kinds == ["clear", "clear", "cubic", "rings", "height-map", "height-map"]
    assert len({taker.name for taker in every}) == 6
    recipe = load_train("any-bank").recipe
    assert recipe.cameras is not None
    for number in range(recipe.cameras.count):
        drawn = random_camera(recipe.cameras, recipe.seed, number, 0, recipe.capture.read_noise).camera
        for taker in every:
            same = drawn.recipe.lens == taker.camera.recipe.lens
            assert not (same and drawn.recipe.focus == taker.camera.recipe.focus)


def test_a_network_for_one_camera_is_refused(tmp_path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cameras, "takers", list)
    with pytest.raises(InputError, match="trained for one camera"):
        cameras.run(tmp_path, lambda done, text: None, network="paper-dcnn")
