"""Masks that block light, given as a map: against masks with a formula, closed forms and differences."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

import edofsim
from edofsim.errors import InputError
from edofsim.optics import Camera, psf_bank
from edofsim.optics.cache import identity
from edofsim.optics.pupil import transmission

GREEN = [543e-9]
DEPTHS = [0.0, 1.2, 2.0]
WAIST = 0.6


def gaussian(samples: int) -> Tensor:
    axis = (torch.arange(samples, dtype=torch.float64) + 0.5) * 2 / samples - 1
    return torch.exp(-(axis**2 + axis[:, None] ** 2) / WAIST**2)


def test_a_map_s_psfs_are_those_of_its_formula() -> None:
    """The formula is evaluated where the pupil is sampled, the map interpolated there."""
    by_formula = edofsim.camera(mask={"kind": "gaussian", "waist": WAIST}, window=48)
    by_map = edofsim.camera(amplitude=gaussian(200), window=48)
    expected, found = (psf_bank(one, GREEN, DEPTHS).values for one in (by_formula, by_map))
    open_wide = psf_bank(edofsim.camera(window=48), GREEN, DEPTHS).values
    apart = (found - expected).flatten(2).norm(dim=2) / expected.flatten(2).norm(dim=2)
    assert float(apart.max()) < 1e-3
    assert float((open_wide - expected).norm() / expected.norm()) > 0.1
    assert transmission(by_map) == pytest.approx(transmission(by_formula), rel=1e-3)
    # the mean of exp(-2 rho^2 / w^2) over the disc
    assert transmission(by_map) == pytest.approx(WAIST**2 / 2 * (1 - math.exp(-2 / WAIST**2)), rel=1e-3)


def test_a_grey_pane_changes_no_psf_and_halves_the_wave_twice() -> None:
    pane = edofsim.camera("paper-cubic", amplitude=torch.full((9, 9), 0.5), window=32)
    plain = edofsim.camera("paper-cubic", window=32)
    found, expected = (psf_bank(one, GREEN, [0.0]).values for one in (pane, plain))
    assert torch.allclose(found, expected, atol=1e-7)
    assert transmission(pane) == pytest.approx(transmission(plain) / 4)
    assert identity(pane) != identity(plain) and pane.key() != plain.key()
    assert pane.without_mask().amplitude is None


@pytest.mark.parametrize("with_height", [False, True])
def test_gradients_are_those_of_differences(with_height: bool) -> None:
    """Of both maps at once, through the share of the light too, in float64."""
    plain = edofsim.camera(window=16)
    generator = torch.Generator().manual_seed(5)
    height = 1e-7 * torch.rand(8, 8, generator=generator, dtype=torch.float64) if with_height else None
    amplitude = 0.2 + 0.6 * torch.rand(8, 8, generator=generator, dtype=torch.float64)
    weights = torch.randn(2, 1, 16, 16, generator=generator, dtype=torch.float64)
    maps = [one.requires_grad_() for one in (height, amplitude) if one is not None]

    def value(given: Camera) -> Tensor:
        return (psf_bank(given, GREEN, [0.5, 2.0], dtype=torch.float64).values * weights).sum()

    value(plain.with_height(height).with_amplitude(amplitude)).backward()
    for one, step in zip(reversed(maps), (1e-5, 1e-12), strict=False):
        toward = torch.randn(8, 8, generator=generator, dtype=torch.float64)
        with torch.no_grad():
            ends = []
            for sign in (1, -1):
                moved = [each + sign * step * toward if each is one else each for each in maps]
                relief = moved[0] if with_height else None
                ends.append(float(value(plain.with_height(relief).with_amplitude(moved[-1]))))
        expected = (ends[0] - ends[1]) / (2 * step)
        assert float((one.grad * toward).sum()) == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize(
    ("amplitude", "said"),
    [
        (torch.full((4, 4), 1.1), "from 0"),
        (torch.full((4, 4), -0.1), "from 0"),
        (torch.full((4, 4), math.nan), "NaN"),
        (torch.ones(4, 5), "square"),
        (torch.ones(4, 4, dtype=torch.int64), "real"),
    ],
)
def test_what_is_no_amplitude_is_refused(amplitude: Tensor, said: str) -> None:
    with pytest.raises(InputError, match=said):
        edofsim.camera(amplitude=amplitude)


def test_a_mask_that_lets_nothing_through_is_refused() -> None:
    with pytest.raises(InputError, match="lets no light through"):
        psf_bank(edofsim.camera(amplitude=torch.zeros(4, 4), window=16), GREEN, [0.0])
