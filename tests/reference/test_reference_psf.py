"""The clipped pupil's wave optics: against the PSFs of `optics`, and against Fresnel's integral."""

from __future__ import annotations

import math

import pytest
import torch
from scipy.special import fresnel

from edofsim.optics import defocus, plan_sampling, psf_bank
from edofsim.optics.masks.clear import ClearMask
from edofsim.optics.masks.cubic import CubicMask
from edofsim.optics.pupil import aperture, pupil_function
from edofsim.reference.clipped_psf import clipped_psf, make_transform, shadow

BAND = 543e-9
DEPTHS = torch.tensor([0.0, 0.8, 1.7], dtype=torch.float64)


def through(camera, window: int, wave=None):
    """PSFs of points at DEPTHS whose light reaches the pupil as `wave` (default: freely), and the grid."""
    grid = plan_sampling(camera, torch.tensor([BAND], dtype=torch.float64), DEPTHS, window)
    opening = aperture(camera, grid)
    wave = torch.ones(len(DEPTHS), grid.samples, grid.samples) if wave is None else wave(grid)
    psi = defocus(camera, BAND, DEPTHS)
    transform = make_transform(camera, grid, BAND, window)
    return clipped_psf(pupil_function(camera, opening, BAND), opening, psi, wave, transform), grid


@pytest.mark.parametrize("window", [24, 25])
@pytest.mark.parametrize("mask", [ClearMask(), CubicMask(alpha_rad=12.0)])
def test_a_point_that_the_whole_pupil_sees_has_the_bank_s_psf(screens, mask, window):
    camera = screens.camera(1.0, window, mask)
    got, _ = through(camera, window)
    bank = psf_bank(camera, [BAND], DEPTHS, window_px=window, dtype=torch.float64).values[:, 0]
    assert got.shape == bank.shape
    assert (got - bank).abs().max() < 2e-5 * bank.max()


def test_two_halves_of_the_pupil_let_half_of_the_light_through_each(screens):
    """By Parseval's theorem; and at large defocus each half is dark where the other one is bright."""
    camera = screens.camera(1.0, 64)

    def half(grid, upper: bool):
        rows = torch.zeros(grid.samples, grid.samples)
        rows[: grid.samples // 2 if upper else None, :] = 1
        rows = rows if upper else rows.flip(0)
        return (rows if upper else 1 - half(grid, True)[0]).expand(len(DEPTHS), -1, -1)

    upper, _ = through(camera, 64, lambda grid: half(grid, True))
    lower, _ = through(camera, 64, lambda grid: half(grid, False))
    whole, _ = through(camera, 64)
    assert torch.allclose(upper.sum((1, 2)), whole.sum((1, 2)) / 2, atol=4e-3)
    rows = torch.arange(64, dtype=torch.float64) - 32
    centre = (upper[2].sum(1) @ rows / upper[2].sum()).item()
    # a point nearer than the focus, seen through the upper half alone: the lower half of its upright disc
    blur = 2 * camera.aperture_radius * camera.sensor_distance / camera.pixel * 0.7 / 2
    assert centre == pytest.approx(4 / (3 * math.pi) * blur, rel=0.05)
    above = upper[2][:31].sum() / upper[2].sum()
    assert above < 0.15  # what is left there is diffraction
    mirrored = lower[2][1:].flip(0)  # about the centre, row 32
    assert (mirrored - upper[2][1:]).abs().max() < 0.02 * upper[2].max()


def test_nothing_in_the_way_leaves_the_wave_as_it_is(screens):
    _, grid = through(screens.camera(1.0, 24), 24)
    wave = shadow(torch.ones(2, 96, 96), torch.tensor([0.5, 1.0]), 4 * grid.radius, BAND, grid)
    assert torch.equal(wave, torch.ones_like(wave))


@pytest.mark.parametrize("nearer", [0.4, 1.5])
def test_a_straight_edge_casts_fresnel_s_shadow(screens, nearer):
    """Behind a half-plane the wave is (1 + j)/2 times Fresnel's integral from the edge on (Born and Wolf,
    section 8.7.3), with the edge at a distance that has 1/d = `nearer`."""
    _, grid = through(screens.camera(1.0, 24), 24)
    rays, width = 192, 4 * grid.radius
    opaque = torch.zeros(1, rays, rays)
    opaque[:, :, rays // 2 :] = 1  # light passes on the right half
    wave = shadow(opaque, torch.tensor([nearer]), width, BAND, grid)[0]
    s = grid.centres.numpy()
    sine, cosine = fresnel(s * math.sqrt(2 * nearer / BAND))
    expected = ((1 - 1j) / 2) * ((cosine + 0.5) + 1j * (sine + 0.5))
    inside = abs(s) < 0.8 * grid.radius
    got = wave[grid.samples // 2].abs().double().numpy()
    assert abs(got - abs(expected))[inside].max() < 0.06
    assert abs(got - abs(expected))[inside].mean() < 0.02
