"""PSFs shared out among parts of the pupil."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from torch import Tensor

from edofsim.capture.blurring import white_psfs
from edofsim.capture.convolution import Grid
from edofsim.capture.occlusion.sub_apertures import spectra_of
from edofsim.capture.prepare import blur_per_dioptre
from edofsim.errors import InputError
from edofsim.optics import (
    Camera,
    PsfField,
    between_part_variance,
    focus_distance,
    plan_sampling,
    psf_bank,
    sub_aperture_psfs,
)
from edofsim.optics.grid import PupilGrid, disc_coverage
from edofsim.optics.masks.clear import ClearMask
from edofsim.optics.masks.cubic import CubicMask
from edofsim.optics.sampling import sampled_alike
from edofsim.optics.sub_apertures import _window, partition, windows_along
from edofsim.recipe import CameraRecipe, load_camera
from edofsim.recipe.camera import PsfSettings

WAVELENGTHS = [482e-9, 611e-9]
DEPTHS = [0.0, 1.0, 1.9]


def pupil_windows(grid: PupilGrid, across: int, intensity: Tensor) -> Tensor:
    """The windows of all parts of a `partition` over the pupil, float64 [part, samples, samples]."""
    along = windows_along(grid, across)
    parts = partition(along, intensity)
    return torch.stack([_window(along, part) for part in parts])


@pytest.mark.parametrize("mask", [ClearMask(), CubicMask(alpha_rad=30.0)])
@pytest.mark.parametrize("across", [1, 2, 5])
def test_parts_sum_up_to_the_whole(mask, across):
    camera = Camera.from_recipe(CameraRecipe(name="parts", mask=mask))
    parts = list(sub_aperture_psfs(camera, WAVELENGTHS, DEPTHS, across, window_px=32, dtype=torch.float64))
    whole = psf_bank(camera, WAVELENGTHS, DEPTHS, window_px=32, dtype=torch.float64).values
    assert (sum(parts) - whole).abs().max() < 1e-12
    assert 1 <= len(parts) <= across**2


@pytest.mark.parametrize("pupil_um", [20.0, 21.7])
def test_parts_that_share_work_are_those_of_two_whole_waves_each(pupil_um):
    """Re(F* F_j) from transforms that a row of parts shares, against (|F + F_j|^2 - |F - F_j|^2) / 4 by the
    adjoint's own propagation; through a relief without symmetries, on even and odd grids."""
    torch.set_num_threads(3)  # wavelengths are shared out among threads
    recipe = CameraRecipe(name="parts", psf=PsfSettings(window_px=32, pupil_sampling_um=pupil_um))
    camera = Camera.from_recipe(recipe)
    draw = torch.Generator().manual_seed(1)
    height = 1e-6 * torch.rand(40, 40, generator=draw, dtype=torch.float64)
    how = {"window_px": 32, "dtype": torch.float64}
    fast = list(sub_aperture_psfs(camera.with_height(height), WAVELENGTHS, DEPTHS, 5, **how))
    slow = list(sub_aperture_psfs(camera.with_height(height.requires_grad_()), WAVELENGTHS, DEPTHS, 5, **how))
    assert len(fast) == len(slow) > 9
    for one, other in zip(fast, slow, strict=True):
        assert (one - other.detach()).abs().max() < 1e-13


def test_a_part_sends_its_light_where_its_rays_go():
    """The centroid of a part's light is the mean of its rays (the slope of the phase over the part), with
    interference and all: moving the point by D dioptres moves it by the part's middle, in radii, times D
    times half of the geometric blur's diameter per dioptre."""
    camera = Camera.from_recipe(CameraRecipe(name="parts"))
    depths, window, across = [0.2, 1.2, 2.2], 96, 2
    axis = torch.arange(window, dtype=torch.float64) - window // 2
    bands, at = torch.tensor([546e-9]).double(), torch.tensor(depths).double()
    grid = plan_sampling(camera, bands, at, window)
    disc = disc_coverage(grid, grid.radius)
    windows = pupil_windows(grid, across, disc)
    right, up = grid.normalised()
    given = sub_aperture_psfs(camera, [546e-9], depths, across, window_px=window, dtype=torch.float64)
    for values, part in zip(given, windows, strict=True):
        light = values.sum((-1, -2)).squeeze(1)
        weight = part * disc
        for centroid, middle in (
            ((values.sum(-2) @ axis).squeeze(1) / light, (weight * right).sum() / weight.sum()),
            ((values.sum(-1) @ axis).squeeze(1) / light, -(weight * up).sum() / weight.sum()),
        ):
            moved = float(centroid[2] - centroid[0]) / (depths[2] - depths[0])
            assert abs(moved) == pytest.approx(abs(float(middle)) * blur_per_dioptre(camera) / 2, rel=0.03)
            # all parts the same way round
            assert moved * float(middle) < 0


def test_parts_in_pixels_three_times_as_wide_are_sums_over_fine_ones():
    """Of nine pixels each. Samples that are farther apart tell such sums to 0.003 of all light."""
    camera = Camera.from_recipe(CameraRecipe(name="parts"))
    how = {"window_px": 51, "dtype": torch.float64}
    fine = list(sub_aperture_psfs(camera, WAVELENGTHS, DEPTHS, 3, **how))
    coarse = list(sub_aperture_psfs(camera, WAVELENGTHS, DEPTHS, 3, side=3, **how))
    for one, other in zip(fine, coarse, strict=True):
        sums = one.unflatten(-1, (17, 3)).unflatten(-3, (17, 3)).sum((-1, -3))
        middle = (other.shape[-1] - 17) // 2
        found = other[..., middle : middle + 17, middle : middle + 17]
        assert (found - sums).abs().max() < 3e-3
        assert (found - sums).sum((-1, -2)).abs().max() < 3e-3


@pytest.mark.parametrize("side", [2, 3, 4])
@pytest.mark.parametrize("nm", [420, 450, 543])
def test_parts_have_all_their_light_in_focus(side: int, nm: float):
    """In coarse pixels too, however sharp the PSF of the whole pupil is."""
    camera = Camera.from_recipe(load_camera("paper-clear").recipe)
    sharp = 1 / float(focus_distance(camera, 1e-9 * nm))
    how = {"window_px": 64, "dtype": torch.float64}
    fine, coarse = (
        [float(part.sum()) for part in sub_aperture_psfs(camera, [1e-9 * nm], [sharp], 6, side=n, **how)]
        for n in (1, side)
    )
    assert coarse == pytest.approx(fine, rel=3e-3)


@pytest.mark.parametrize("side", [1, 2])
def test_depths_on_grids_of_their_own_have_the_parts_of_one_grid(side):
    """In the order of the depths, which is none of theirs; what the coarser grids leave out is small."""
    camera = Camera.from_recipe(CameraRecipe(name="parts", mask=CubicMask(alpha_rad=30.0)))
    depths = [0.3, 3.6, 1.2, 0.0, 2.4]
    how = {"window_px": 48, "side": side, "dtype": torch.float64}
    found = list(sub_aperture_psfs(camera, WAVELENGTHS, depths, 3, coarsely=True, **how))
    whole = list(sub_aperture_psfs(camera, WAVELENGTHS, depths, 3, **how))
    bands, at = (torch.tensor(axis).double() for axis in (WAVELENGTHS, depths))
    assert len(sampled_alike(camera, bands, at, 48)) > 1 and len(found) == len(whole)
    largest = max(float(one.abs().max()) for one in whole)
    for one, other in zip(found, whole, strict=True):
        assert one.shape == other.shape
        assert 0 < (one - other).abs().max() < 2e-3 * largest


def test_windows_sum_to_one_and_dark_parts_are_joined():
    grid = PupilGrid(64, 2.5e-3 / 28, 2.5e-3)
    axis = grid.centres / grid.radius
    disc = (axis[:, None] ** 2 + axis[None, :] ** 2 <= 1).double()
    for across in (1, 2, 7):
        windows = pupil_windows(grid, across, disc)
        assert (windows.sum(0) - 1).abs().max() < 1e-12
        assert (windows >= 0).all()
    # corners of 7 x 7 squares lie outside the disc
    assert len(pupil_windows(grid, 7, disc)) < 49
    half = disc * (axis[None, :] > 0)
    assert len(pupil_windows(grid, 4, half)) <= math.ceil(len(pupil_windows(grid, 4, disc)) * 0.75)


@pytest.mark.parametrize("across", [2, 3])
def test_parts_tell_the_share_of_rays_that_lies_between_them(across):
    """Half a million rays through a disc, each in a part that its raised cosines drew: the variance of the
    parts' means over that of all rays."""
    draw = np.random.default_rng(3)
    ray = draw.uniform(-1, 1, (500_000, 2))
    ray = ray[(ray**2).sum(1) <= 1]
    place = np.clip((ray + 1) * across / 2 - 0.5, 0, across - 1)
    below = np.floor(place)
    chance = np.sin(np.pi / 2 * (place - below)) ** 2  # of the next part
    part = below + (draw.uniform(size=ray.shape) < chance)
    number = (part[:, 0] * across + part[:, 1]).astype(int)
    means = np.stack([ray[number == n].mean(0) for n in range(across**2)])
    rays = np.bincount(number, minlength=across**2)
    expected = (rays * (means**2).sum(1)).sum() / (ray**2).sum()
    camera = Camera.from_recipe(CameraRecipe(name="parts"))
    assert between_part_variance(camera, across) == pytest.approx(expected, abs=3e-3)


def test_more_parts_tell_more_and_one_part_nothing():
    camera = Camera.from_recipe(CameraRecipe(name="parts", mask=CubicMask(alpha_rad=30.0)))
    told = [between_part_variance(camera, across) for across in (1, 2, 4, 8, 16)]
    assert abs(told[0]) < 1e-12
    assert told == sorted(told)
    assert 0.98 < told[-1] < 1


@pytest.mark.parametrize("coarsely", [False, True])
def test_gradients_reach_the_height_map(coarsely):
    recipe = load_camera("paper-clear").recipe
    camera = Camera.from_recipe(recipe)
    height = (torch.rand(32, 32, generator=torch.Generator().manual_seed(1)) * 1e-6).requires_grad_()
    camera = camera.with_height(height)
    how = {"window_px": 16, "coarsely": coarsely, "dtype": torch.float64}
    third = list(sub_aperture_psfs(camera, [546e-9], [1.5, 4.0], 2, **how))[2]
    third[0, 0, 9, 5].backward()
    assert torch.isfinite(height.grad).all()
    assert height.grad.abs().max() > 0


@pytest.mark.parametrize("across", [0, -1, 17])
def test_a_number_of_parts_out_of_range(across):
    camera = Camera.from_recipe(CameraRecipe(name="parts"))
    with pytest.raises(InputError, match="sub-apertures"):
        next(sub_aperture_psfs(camera, [546e-9], [1.0], across))


def test_what_blocks_a_part_whose_light_has_left_the_window():
    """A blur three times as wide as the window: what is left of an outer part there is diffraction of either
    sign, whose normalised sum would be noise. Sums of magnitudes say how far coverage may be off."""
    recipe = load_camera("paper-clear").recipe
    camera = Camera.from_recipe(recipe)
    bands, nodes = torch.tensor(WAVELENGTHS).double(), torch.tensor([0.0, 1.0, 4.0]).double()
    whole = PsfField(psf_bank(camera, bands, nodes, window_px=24).values, nodes, bands)
    response = torch.tensor([[1.0, 0.0], [0.5, 0.5]])
    grid, worst, naive = Grid(48, 48, 0, 24), 0.0, 0.0
    for values in sub_aperture_psfs(camera, bands, nodes, 6, window_px=24):
        part = PsfField(values, nodes, bands)
        spectra = [blocking for _, blocking in spectra_of(part, whole, response)(range(3), grid).values()]
        opaque = torch.fft.irfft2(torch.stack(spectra), s=grid.transform)
        assert (opaque.sum((-2, -1)) - 1).abs().max() < 1e-5
        worst = max(worst, float(opaque.abs().sum((-2, -1)).max()))
        naive = max(naive, float(white_psfs(part, response).values.abs().sum((-2, -1)).max()))
    assert worst < 3 < naive


def test_windows_are_dark_beyond_their_neighbours():
    """What is exactly zero is left out of the transforms: most of each window."""
    grid = PupilGrid(60, 2.5e-3 / 30, 2.5e-3)
    along = windows_along(grid, 6)
    torch.testing.assert_close(along.sum(0), torch.ones(60, dtype=torch.float64))
    assert int((along != 0).sum(1).max()) <= 20
