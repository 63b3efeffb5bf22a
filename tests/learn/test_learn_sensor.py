"""Photos of a training are recorded by the same list of effects as those of a camera."""

from __future__ import annotations

import math
from types import SimpleNamespace

import pytest
import torch

import edofsim
from edofsim.learn.system import Captured, Draw, recorded
from edofsim.optics import Camera

LIGHT, DRAWN, WELL, STEPS = 0.5, 0.02, 400, 31


@pytest.fixture(scope="module")
def camera() -> Camera:
    """Its own read noise is half of full scale: the training draws another one."""
    sensor = {"read_noise": 0.5, "full_well_electrons": WELL, "bits": 5, "bayer": "RGGB"}
    plain = edofsim.camera("paper-clear", window=32)
    recipe = plain.recipe.model_copy(update={"sensor": plain.recipe.sensor.model_copy(update=sensor)})
    return Camera.from_recipe(recipe, plain.base)


def test_photos_of_a_training_have_all_effects_of_the_sensor(camera: Camera):
    """Whole steps of the converter; one colour a pixel; the variance is that of counted light, of the read
    noise of the draw, and of rounding, within five standard errors; gradients pass."""
    clean = torch.full((1, 3, 96, 96), LIGHT, requires_grad=True)
    draw = Draw(SimpleNamespace(), torch.tensor([DRAWN]), torch.Generator().manual_seed(1))
    image = recorded(Captured(clean, clean, torch.tensor(0.0)), draw, camera)
    torch.testing.assert_close(STEPS * image, (STEPS * image).round(), rtol=0, atol=1e-4)
    seen = image[0, 1][image[0, 1] > 0]
    assert seen.numel() == 96 * 96 // 2 and int((image > 0).sum()) == 96 * 96
    variance = LIGHT / WELL + DRAWN**2 + 1 / STEPS**2 / 12
    assert float(seen.detach().var()) == pytest.approx(variance, rel=5 * math.sqrt(2 / seen.numel()))
    image.sum().backward()
    assert float(clean.grad.sum()) == 96 * 96


def test_less_light_has_more_noise_in_the_light_of_the_axis(camera: Camera):
    """Half of the light is counted as half of the electrons, and brightened after that."""
    clean = torch.full((1, 3, 96, 96), LIGHT)
    draw = Draw(SimpleNamespace(), torch.tensor([DRAWN]), torch.Generator().manual_seed(1))
    half = Captured(clean, clean, torch.tensor(0.0), light=torch.tensor([0.5]))
    seen = recorded(half, draw, camera)[0, 1]
    seen = seen[seen > 0]
    assert float(seen.mean()) == pytest.approx(LIGHT, abs=0.01)
    variance = 4 * (LIGHT / 2 / WELL + DRAWN**2 + 1 / STEPS**2 / 12)
    assert float(seen.var()) == pytest.approx(variance, rel=5 * math.sqrt(2 / seen.numel()))
