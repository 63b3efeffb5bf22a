"""The sensor: each effect against its definition, all off by default."""

from __future__ import annotations

import math

import pytest
import torch

from edofsim.capture.sensor import SensorEffects, automatic_exposure, record
from edofsim.errors import InputError

GREY = torch.full((3, 120, 121), 0.4, dtype=torch.float64)


def test_everything_is_off_by_default():
    assert torch.equal(record(GREY * 3 - 0.5, SensorEffects(), seed=1), GREY * 3 - 0.5)


def test_read_noise_is_gaussian_of_the_given_deviation():
    """The paper's Eq. `SensorImage`; a deviation from n samples errs by sigma / sqrt(2 n)."""
    noise = record(GREY, SensorEffects(read_noise=0.005), seed=1) - GREY
    n = noise.numel()
    assert abs(noise.std().item() - 0.005) < 4 * 0.005 / math.sqrt(2 * n)
    assert abs(noise.mean().item()) < 4 * 0.005 / math.sqrt(n)
    assert abs((noise.abs() > 0.005).double().mean().item() - 0.3173) < 4 * math.sqrt(0.3173 * 0.6827 / n)


def test_shot_noise_has_the_mean_and_variance_of_a_count():
    """Poisson: mean as the signal (not twice it), variance signal / full well."""
    wells = 1000.0
    image = record(GREY, SensorEffects(full_well=wells), seed=2)
    n, variance = image.numel(), 0.4 / wells
    assert abs(image.mean().item() - 0.4) < 4 * math.sqrt(variance / n)
    assert abs(image.var().item() / variance - 1) < 4 * math.sqrt((2 + 1 / 400) / n)
    counts = image * wells
    assert torch.allclose(counts, counts.round(), atol=1e-6)


def test_saturation_and_quantisation():
    ramp = torch.linspace(-0.5, 1.5, 999, dtype=torch.float64).expand(3, 1, -1)
    assert torch.equal(record(ramp, SensorEffects(saturation=True), 0), ramp.clamp(0, 1))
    coarse = record(ramp, SensorEffects(bits=3), 0)
    assert torch.allclose(torch.unique(coarse), torch.arange(8, dtype=torch.float64) / 7)
    assert (coarse - ramp.clamp(0, 1)).abs().max() <= 0.5 / 7 + 1e-12


@pytest.mark.parametrize(("pattern", "first"), [("RGGB", 0), ("BGGR", 2), ("GRBG", 1), ("GBRG", 1)])
def test_bayer_mosaic(pattern, first):
    """Each pixel sees one channel; a quarter red, half green, a quarter blue; odd sizes too."""
    image = record(torch.ones(3, 5, 7, dtype=torch.float64), SensorEffects(bayer=pattern), 0)
    assert torch.equal(image.sum(0), torch.ones(5, 7, dtype=torch.float64))
    assert image[first, 0, 0] == 1
    noisy = record(torch.ones(3, 6, 8), SensorEffects(bayer=pattern, read_noise=0.1), 0)
    assert (noisy != 0).sum((1, 2)).tolist() == [12, 24, 12]


def test_same_seed_same_noise_other_seed_other_noise():
    effects = SensorEffects(read_noise=0.01, full_well=500)
    assert torch.equal(record(GREY, effects, 7), record(GREY, effects, 7))
    assert not torch.equal(record(GREY, effects, 7), record(GREY, effects, 8))


def test_gradients_pass_the_sensor():
    clean = GREY[:, :4, :4].clone().requires_grad_()
    record(clean, SensorEffects(read_noise=0.01, full_well=500, bits=8), 0).sum().backward()
    assert torch.equal(clean.grad, torch.ones_like(clean))


def test_automatic_exposure_puts_the_percentile_at_its_level():
    values = torch.arange(1, 1001, dtype=torch.float64).reshape(1, 40, 25)
    factor = automatic_exposure(values)
    assert abs(factor * values.flatten().sort().values[994].item() - 0.9) < 1e-12  # 99.5 % of ranks 0 to 999
    assert automatic_exposure(torch.zeros(3, 4, 4)) == 1


def test_bad_sensors_are_named_together():
    with pytest.raises(InputError) as caught:
        SensorEffects(read_noise=-1, full_well=0, bits=0, bayer="RGBW")
    assert len(caught.value.problems) == 4
    with pytest.raises(InputError, match="3 channels, not 1"):
        record(GREY[:1], SensorEffects(bayer="RGGB"), 0)
