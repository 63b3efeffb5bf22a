"""Noise of a view in the ideal image and in the photo, against closed forms and photographed noise."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from edofsim.capture import capture
from edofsim.capture.noise import photo_noise
from edofsim.errors import InputError
from edofsim.optics import Camera
from edofsim.plan import Facts, facts_of
from edofsim.plan.rendered_noise import (
    noise_in,
    noise_in_words,
    photo_noise_of,
    score_error_db,
    view_noise_for,
)
from edofsim.recipe import CameraRecipe, load_scene
from edofsim.recipe.camera import PsfSettings, Sensor
from edofsim.render import Task
from edofsim.render.fetch import place_of
from edofsim.render.view import View
from edofsim.restore.scores import Noise, score

RECIPE = CameraRecipe(
    name="test", psf=PsfSettings(window_px=32), sensor=Sensor(read_noise=0.01, exposure=2.0)
)
CAMERA = Camera.from_recipe(RECIPE)
SIGMA = 0.02


def facts(camera: Camera = CAMERA, sigma: float = SIGMA) -> Facts:
    """Of light 1/4 in six bands, with independent noise of every pixel, alike in all bands."""
    rows, columns = 96, 112
    view = View.flat(
        torch.full((6, rows, columns), 0.25),
        0.5,
        wavelengths=torch.linspace(450e-9, 700e-9, 6),
        pixel_angle=CAMERA.pixel_angle,
        margin=16,
    )
    draw = torch.randn(rows * columns, generator=torch.Generator().manual_seed(1))
    noise = (sigma * draw).expand(6, -1).contiguous()
    return facts_of(replace(view, noise=4 * sigma, half_difference=noise, metadata={"samples": 16}), camera)


def test_noise_of_the_ideal_image_is_that_of_its_pixels():
    """Alike in all bands: a channel's is the deviation, times the sum of its response, times the exposure."""
    found = facts()
    sums = found.response.double().sum(1)
    wanted = SIGMA * 2.0 * float(sums.square().mean().sqrt())
    assert noise_in(found)["truth"] == pytest.approx(wanted, rel=0.03)


def test_noise_of_the_photo_is_as_photographed():
    found = facts()
    photo = capture(found.view, CAMERA, found.full, exposure=2.0)
    noise = photo_noise(found.view, CAMERA, found.full, photo).image
    assert noise is not None
    assert photo_noise_of(found) == pytest.approx(float(noise.double().square().mean().sqrt()), rel=0.01)
    assert noise_in(found)["photo"] == pytest.approx(photo_noise_of(found), rel=0.2)
    assert noise_in(found)["photo"] < 0.8 * noise_in(found)["truth"]


def test_at_the_noise_to_stop_at_what_is_asked_for_is_reached():
    found = facts()
    for place, wanted in {"truth": 10 ** (-45 / 20), "photo": 0.001}.items():
        level = view_noise_for(found, place)
        assert level is not None
        there = facts(sigma=level / 4)
        reached = photo_noise_of(there) if place == "photo" else noise_in(there)[place]
        assert reached == pytest.approx(wanted, rel=0.01)


def test_what_cannot_be_reached_is_said():
    silent = RECIPE.model_copy(update={"sensor": RECIPE.sensor.model_copy(update={"read_noise": 0.0})})
    with pytest.raises(InputError, match="sensor has no noise"):
        view_noise_for(facts(Camera.from_recipe(silent)), "photo")
    found = facts()
    untold = replace(found, view=replace(found.view, half_difference=None))
    with pytest.raises(InputError, match="does not tell its noise"):
        view_noise_for(untold, "truth")
    assert noise_in_words(untold) == ""
    assert view_noise_for(replace(found, view=replace(found.view, noise=0.0)), "truth") is None


def test_samples_are_said_with_what_they_leave():
    assert noise_in_words(facts()).startswith("16 samples a pixel leave noise of ")
    louder = replace(facts(), noise_ratio=2.0)
    quiet = [float(noise_in_words(each).split("noise of ")[1].split(" dB")[0]) for each in (facts(), louder)]
    assert quiet[1] - quiet[0] == pytest.approx(6.0, abs=0.11)


def test_the_error_of_a_score_is_as_scores_tell_it():
    """An image 30 dB off, by errors that are alike in all channels, as noise is."""
    generator = torch.Generator().manual_seed(2)
    truth = torch.full((3, 96, 128), 0.5)
    error, noise, half = (torch.randn(96, 128, generator=generator).expand(3, -1, -1) for _ in range(3))
    image = truth + 10**-1.5 * error
    found = score(image, truth + 0.01 * noise, Noise(0.01 * half, torch.zeros_like(truth)))
    assert found.psnr_db_se == pytest.approx(score_error_db(0.01, 96 * 128, 30.0), rel=0.15)


def test_tasks_that_stop_elsewhere_are_other_views(tmp_path: Path):
    loaded = load_scene("desk")
    tasks = [Task(loaded.recipe, loaded.base, noise) for noise in (None, 0.01, 0.02)]
    keys = {place_of(each.recipe, each.base, tmp_path, each.stops_at(None)).key for each in tasks}
    assert len(keys) == 3
    assert tasks[0].stops_at(0.03) == 0.03 and tasks[1].stops_at(0.03) == 0.01
