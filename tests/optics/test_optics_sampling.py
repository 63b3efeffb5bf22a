"""How finely the pupil is sampled, and when that is refused."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch

from edofsim.errors import InputError
from edofsim.optics import Camera, defocus, plan_sampling, psf_bank
from edofsim.optics.sampling import OWN_GRID, coarsest_pitch, coarsest_pitches, sampled_alike
from edofsim.recipe.camera import CameraRecipe


def camera(sampling="auto", mask=None, **psf) -> Camera:
    settings = {"pupil_sampling_um": sampling, **psf}
    return Camera.from_recipe(CameraRecipe(name="sampled", mask=mask or {"kind": "clear"}, psf=settings))


def plan(seen: Camera, wavelengths_nm, depths=(0.0, 2.0), window=128):
    wavelengths = torch.tensor(wavelengths_nm, dtype=torch.float64) * 1e-9
    return plan_sampling(seen, wavelengths, torch.tensor(depths, dtype=torch.float64), window)


def largest_defocus(seen: Camera, wavelength_nm: float) -> float:
    """Of points at infinity and at 0.5 m."""
    return float(defocus(seen, wavelength_nm * 1e-9, torch.tensor([0.0, 2.0])).abs().max())


def test_the_papers_sampling_is_accepted_for_its_colours():
    chosen = plan(camera(21.0), [482, 543, 611])
    assert chosen.pitch == pytest.approx(21e-6) and chosen.samples == 239
    assert largest_defocus(camera(), 543) == pytest.approx(44.4, abs=0.1)


def test_the_papers_sampling_is_refused_at_420_nm_with_both_numbers():
    with pytest.raises(InputError) as refused:
        plan(camera(21.0), [420])
    bound, period = refused.value.problems
    assert "21 is too coarse" in bound and "16.8 um" in bound and "-58.4" in bound and "infinity" in bound
    # lambda z_i / ds = 420 nm 36.8975 mm / 21 um = 738 um, the window of 128 pixels is 768 um
    assert "738" in period and "768" in period


@pytest.mark.parametrize("mask", ["clear", "cubic", "rings"])
@pytest.mark.parametrize("wavelength", [420, 543, 720])
def test_automatic_sampling_meets_bound_and_window(mask, wavelength):
    seen = camera(mask={"kind": mask})
    for window in (16, 128, 200):
        chosen = plan(seen, [wavelength], window=window)
        bound = seen.aperture_radius * math.pi / (8 * largest_defocus(seen, wavelength))
        assert chosen.pitch <= bound * 1.0001
        # the PSF repeats itself beyond the window
        assert wavelength * 1e-9 * seen.sensor_distance / chosen.pitch >= window * seen.pixel * 0.9999


@pytest.mark.parametrize("mask", ["clear", "cubic"])
def test_phases_allow_a_coarser_pupil_for_estimates(mask):
    """Automatically and at a given pitch, for PSFs that are nearly the same; and neither is kept as the
    other's."""
    exact = camera(mask={"kind": mask})
    quick = replace(exact, by_phase=True)
    bands, depths = [4.5e-7, 6.5e-7], torch.tensor([0.0, 4.0], dtype=torch.float64)
    fine, coarse = (plan_sampling(seen, torch.tensor(bands).double(), depths, 128) for seen in (exact, quick))
    assert coarse.samples < fine.samples
    pitch = coarsest_pitch(quick, torch.tensor(bands).double(), depths, 128)
    assert pitch > coarsest_pitch(exact, torch.tensor(bands).double(), depths, 128)
    whole = psf_bank(exact, bands, depths, window_px=128).values
    with pytest.raises(InputError, match="too coarse"):
        psf_bank(exact.with_pupil_sampling(pitch), bands, depths, window_px=128)
    for seen in (quick, quick.with_pupil_sampling(pitch)):
        apart = psf_bank(seen, bands, depths, window_px=128).values - whole
        error = float(apart.square().sum() / whole.square().sum())
        assert 1e-12 < error < 10**-3.5


def test_automatic_sampling_follows_steep_masks():
    gentle, steep = (plan(camera(mask={"kind": "cubic", "alpha_rad": a}), [543]) for a in (10.0, 200.0))
    # 3 alpha / r of slope need pi / (2 slope)
    assert steep.pitch < math.pi / 2 / (3 * 200 / 2.5e-3)
    assert gentle.pitch > 2 * steep.pitch


@pytest.mark.parametrize(
    "samples, window",
    [(84, 128), (239, 32), *(pytest.param(*each, marks=pytest.mark.slow) for each in ((84, 32), (239, 128)))],
)
def test_what_the_cells_of_a_height_map_scatter_stays_out_of_the_window(samples, window):
    """Against a pupil sampled three times as finely again: 0.5 % of the PSFs, in the rough map's own samples
    several times as much."""
    draw = torch.Generator().manual_seed(0)
    rough = 0.2e-6 * torch.rand(samples, samples, generator=draw, dtype=torch.float64)
    wavelengths, depths = [430e-9, 650e-9], [0.5, 0.8]

    def psfs(sampling):
        return psf_bank(
            camera(sampling).with_height(rough), wavelengths, depths, window_px=window, dtype=torch.float64
        )

    found = psfs("auto")
    at = torch.tensor(wavelengths), torch.tensor(depths), window
    truth = psfs(plan_sampling(camera("auto").with_height(rough), *at).pitch * 1e6 / 3).values
    size = truth.norm(dim=(2, 3))
    assert ((found.values - truth).norm(dim=(2, 3)) / size).max() < 5e-3
    if (samples, window) == (239, 32):  # elsewhere the samples of the map itself are refused as too coarse
        assert ((psfs(5000 / samples).values - truth).norm(dim=(2, 3)) / size).max() > 2e-2


def test_maps_in_the_recipe_and_in_its_place_are_sampled_alike():
    free = plan(camera(mask={"kind": "height-map", "pitch_um": 5000 / 238}), [543])
    seen = camera().with_height(torch.zeros(238, 238))
    given = plan_sampling(seen, torch.tensor([543e-9]), torch.tensor([0.0, 2.0]), 128)
    assert given == free and free.pitch < 5e-3 / 238 / 2


def test_work_too_large_is_refused_before_it_begins():
    with pytest.raises(InputError, match="samples across the pupil"):
        plan(camera(), [420], window=60000)


def test_replicas_would_fold_into_the_window():
    # what the check guards against: a pupil sampled too coarsely shows its replica in the window
    seen = camera(60.0, window_px=40)
    period = 543e-9 * seen.sensor_distance / 60e-6 / seen.pixel
    assert 40 < period < 60
    with pytest.raises(InputError, match="repeats the PSF"):
        psf_bank(seen, [543e-9], [0.8], window_px=64)


@pytest.mark.parametrize("mask", [{"kind": "clear"}, {"kind": "cubic"}])
def test_the_coarsest_pitches_are_the_coarsest_that_are_taken(mask):
    """Each a thousandth finer than the limit, by trying: a fixed sampling of that is taken, a little coarser
    not."""
    bands, depths = torch.tensor([450e-9, 620e-9], dtype=torch.float64), torch.tensor([0.0, 0.6, 1.1, 2.0])
    each = coarsest_pitches(camera(mask=mask), bands, depths, 128)
    for pitch, depth in zip(each, depths.tolist(), strict=True):
        plan(camera(pitch * 1e6, mask), [450, 620], (depth,))
        with pytest.raises(InputError, match="coarse|repeats"):
            plan(camera(pitch * 1e6 * 1.002, mask), [450, 620], (depth,))
    assert len(set(each)) > 1 and coarsest_pitch(camera(mask=mask), bands, depths, 128) == min(each)


@pytest.mark.parametrize("relief_um", [None, 16.0, 3.0])
def test_depths_share_a_pitch_that_each_of_them_takes(relief_um):
    """Every depth once; a fixed sampling of the group's pitch is taken for each, and none would do with one
    `OWN_GRID` times as coarse; samples of a height map are seen wherever the finest pitch sees them."""
    bands, depths = torch.tensor([450e-9, 620e-9], dtype=torch.float64), torch.linspace(0, 3.8, 14).double()
    seen = camera(window_px=64)
    if relief_um is not None:
        seen = seen.with_height(torch.zeros(round(5e3 / relief_um), round(5e3 / relief_um)))
    groups = sampled_alike(seen, bands, depths, 64)
    assert sorted(torch.cat([some for some, _ in groups]).tolist()) == list(range(14))
    finest = min(pitch for _, pitch in groups)
    for some, pitch in groups:
        plan(camera(pitch * 1e6), [450, 620], depths[some].tolist(), 64)
        assert relief_um is None or pitch <= max(finest, 1.01e-6 * relief_um)
        for depth in depths[some] if relief_um is None else ():
            with pytest.raises(InputError, match="coarse|repeats"):
                plan(camera(pitch * 1e6 * OWN_GRID * 1.002), [450, 620], (float(depth),), 64)
    assert len(groups) == {None: 4, 16.0: 2, 3.0: 1}[relief_um]
