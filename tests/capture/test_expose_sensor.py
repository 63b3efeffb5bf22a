"""The sensor: each effect against its definition, all off by default."""

from __future__ import annotations

import math

import pytest
import torch

from edofsim.capture import Fidelity
from edofsim.capture.sensor import SensorEffect, automatic_exposure, record, sensor_effects
from edofsim.errors import InputError
from edofsim.optics import Camera
from edofsim.recipe import CameraRecipe


def effects(**sensor: object) -> tuple[SensorEffect, ...]:
    """What a sensor with these keys of a recipe does; without read noise unless it is asked for."""
    recipe = CameraRecipe.model_validate({"name": "s", "sensor": {"read_noise": 0.0, **sensor}})
    return sensor_effects(Camera.from_recipe(recipe))


GREY = torch.full((3, 120, 121), 0.4, dtype=torch.float64)


def test_everything_is_off_by_default():
    assert torch.equal(record(GREY * 3 - 0.5, effects(), seed=1), GREY * 3 - 0.5)


def test_read_noise_is_gaussian_of_the_given_deviation():
    """The paper's Eq. `SensorImage`; a deviation from n samples errs by sigma / sqrt(2 n)."""
    noise = record(GREY, effects(read_noise=0.005), seed=1) - GREY
    n = noise.numel()
    assert abs(noise.std().item() - 0.005) < 4 * 0.005 / math.sqrt(2 * n)
    assert abs(noise.mean().item()) < 4 * 0.005 / math.sqrt(n)
    assert abs((noise.abs() > 0.005).double().mean().item() - 0.3173) < 4 * math.sqrt(0.3173 * 0.6827 / n)


def test_shot_noise_has_the_mean_and_variance_of_a_count():
    """Poisson: mean as the signal (not twice it), variance signal / full well."""
    wells = 1000.0
    image = record(GREY, effects(full_well_electrons=wells), seed=2)
    n, variance = image.numel(), 0.4 / wells
    assert abs(image.mean().item() - 0.4) < 4 * math.sqrt(variance / n)
    assert abs(image.var().item() / variance - 1) < 4 * math.sqrt((2 + 1 / 400) / n)
    counts = image * wells
    assert torch.allclose(counts, counts.round(), atol=1e-6)


def test_saturation_and_quantisation():
    ramp = torch.linspace(-0.5, 1.5, 999, dtype=torch.float64).expand(3, 1, -1)
    assert torch.equal(record(ramp, effects(saturation=True), 0), ramp.clamp(0, 1))
    coarse = record(ramp, effects(bits=3), 0)
    assert torch.allclose(torch.unique(coarse), torch.arange(8, dtype=torch.float64) / 7)
    assert (coarse - ramp.clamp(0, 1)).abs().max() <= 0.5 / 7 + 1e-12


@pytest.mark.parametrize(("pattern", "first"), [("RGGB", 0), ("BGGR", 2), ("GRBG", 1), ("GBRG", 1)])
def test_bayer_mosaic(pattern, first):
    """Each pixel sees one channel; a quarter red, half green, a quarter blue; odd sizes too."""
    image = record(torch.ones(3, 5, 7, dtype=torch.float64), effects(bayer=pattern), 0)
    assert torch.equal(image.sum(0), torch.ones(5, 7, dtype=torch.float64))
    assert image[first, 0, 0] == 1
    noisy = record(torch.ones(3, 6, 8), effects(bayer=pattern, read_noise=0.1), 0)
    assert (noisy != 0).sum((1, 2)).tolist() == [12, 24, 12]


def test_same_seed_same_noise_other_seed_other_noise():
    noisy = effects(read_noise=0.01, full_well_electrons=500)
    assert torch.equal(record(GREY, noisy, 7), record(GREY, noisy, 7))
    assert not torch.equal(record(GREY, noisy, 7), record(GREY, noisy, 8))


def test_gradients_pass_the_sensor():
    clean = GREY[:, :4, :4].clone().requires_grad_()
    record(clean, effects(read_noise=0.01, full_well_electrons=500, bits=8), 0).sum().backward()
    assert torch.equal(clean.grad, torch.ones_like(clean))


def test_automatic_exposure_puts_the_percentile_at_its_level():
    values = torch.arange(1, 1001, dtype=torch.float64).reshape(1, 40, 25)
    factor = automatic_exposure(values)
    assert abs(factor * values.flatten().sort().values[994].item() - 0.9) < 1e-12  # 99.5 % of ranks 0 to 999
    assert automatic_exposure(torch.zeros(3, 4, 4)) == 1


def test_a_mosaic_needs_three_channels():
    with pytest.raises(InputError, match="3 channels, not 1"):
        record(GREY[:1], effects(bayer="RGGB"), 0)


def test_what_a_fidelity_leaves_out_does_not_act():
    every = {"bayer": "RGGB", "full_well_electrons": 500, "read_noise": 0.01, "saturation": True, "bits": 8}
    recipe = CameraRecipe.model_validate({"name": "s", "sensor": every})
    camera = Camera.from_recipe(recipe)
    kinds = ["bayer-mosaic", "shot-noise", "read-noise", "saturation", "quantisation"]
    assert [effect.kind for effect in sensor_effects(camera)] == kinds
    left = {"mosaic": False, "shot_noise": False, "read_noise": False, "saturation": False}
    assert [effect.kind for effect in sensor_effects(camera, Fidelity(**left))] == ["quantisation"]


def test_what_a_recipe_lists_comes_last_and_in_order():
    """The same clipping and rounding by the list as by the recipe's own keys."""
    listed = effects(effects=[{"kind": "saturation"}, {"kind": "quantisation", "bits": 3}])
    ramp = torch.linspace(-0.5, 1.5, 999, dtype=torch.float64).expand(3, 1, -1)
    assert torch.equal(record(ramp, listed, 0), record(ramp, effects(saturation=True, bits=3), 0))
