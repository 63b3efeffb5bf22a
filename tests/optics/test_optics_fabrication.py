"""From design to device: upsampling, wrapping, levels, errors."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest
import torch
from safetensors.torch import save_file

from edofsim.errors import InputError
from edofsim.optics import Camera, material, plan_sampling, psf_bank
from edofsim.optics.fabrication import make, wave_height
from edofsim.optics.grid import PupilGrid, bicubic_matrix, resample
from edofsim.optics.height import load_height_map, natural_samples, surface
from edofsim.recipe.camera import CameraRecipe
from edofsim.recipe.fabrication import Fabrication

RESIST = material("S1813")
GREEN = 543e-9


def camera(**recipe) -> Camera:
    return Camera.from_recipe(CameraRecipe(name="made", **recipe))


def ramp(deepest_um: float, samples: int = 64) -> torch.Tensor:
    return torch.linspace(0, deepest_um * 1e-6, samples, dtype=torch.float64).expand(samples, samples)


def write_height_map(path: Path, height: torch.Tensor, pitch_um: float) -> Path:
    """As `load_height_map` documents it."""
    save_file({"height_m": height}, path, {"edofsim": json.dumps({"pitch_um": pitch_um})})
    return path


def test_upsampling_reproduces_parabolas():
    # Keys' kernel is exact for quadratics, away from the edge
    samples = 21
    axis = (torch.arange(samples, dtype=torch.float64) - 10) * 21e-6
    coarse = axis[:, None] ** 2 + 0.5 * axis[None, :] ** 2 + axis[:, None] * 1e-5
    grid = PupilGrid(147, 3e-6, 1.0)
    fine = resample(coarse, 21e-6, grid, 1.0)
    there = grid.centres
    expected = there[:, None] ** 2 + 0.5 * there[None, :] ** 2 + there[:, None] * 1e-5
    inner = slice(14, -14)
    assert torch.allclose(fine[inner, inner], expected[inner, inner], atol=1e-18)


def test_upsampling_leaves_wraps_as_steps():
    """A bowl of four waves, wrapped, between its samples: the smooth one less whole waves."""
    wave = wave_height(GREEN, RESIST)
    axis = (torch.arange(81, dtype=torch.float64) - 40) / 40
    smooth = 2 * wave * (axis[:, None] ** 2 + axis[None, :] ** 2)
    wrapped = (smooth - torch.floor(smooth / wave) * wave).requires_grad_()
    grid = PupilGrid(567, 3e-6, 1.0)
    fine = resample(wrapped, 21e-6, grid, wave)
    waves = (fine.detach() - resample(smooth, 21e-6, grid, wave)) / wave
    assert torch.allclose(waves, waves.round(), rtol=0, atol=1e-9) and waves.min() < -3
    assert -0.1 * wave < fine.min() and fine.max() < 1.1 * wave
    # the same as without wraps is what gradients see
    weights = torch.rand(567, 567, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    (fine * weights).sum().backward()
    matrix = bicubic_matrix(567, 3e-6, 81, 21e-6)
    assert torch.allclose(wrapped.grad, matrix.T @ weights @ matrix)


@pytest.mark.parametrize("made", [None, Fabrication(pitch_um=7.0)])
def test_a_wrapped_map_is_made_as_bright_as_the_smooth_one(made: Fabrication | None):
    """At its design wavelength a wrap is no step of the wave: no PSF changes, however finely it is made."""
    free = camera(mask={"kind": "height-map", "pitch_um": 21.0}, fabrication=made, psf={"window_px": 32})
    wave = wave_height(GREEN, RESIST)
    axis = (torch.arange(239, dtype=torch.float64) - 119) / 119
    smooth = 3 * wave * (axis[:, None] ** 3 + axis[None, :] ** 3)
    wrapped = smooth - torch.floor(smooth / wave) * wave
    how = {"dtype": torch.float64}
    first, second = (psf_bank(free.with_height(h), [GREEN], [0.5], **how) for h in (smooth, wrapped))
    assert torch.allclose(first.values, second.values, rtol=0, atol=1e-9 * float(first.values.max()))


def test_upsampling_keeps_samples_and_constants():
    matrix = bicubic_matrix(63, 3e-6, 9, 21e-6)
    assert torch.allclose(matrix.sum(1), torch.ones(63, dtype=torch.float64))
    assert torch.allclose(matrix[3::7], torch.eye(9, dtype=torch.float64), atol=1e-12)


def test_wrapping_takes_whole_waves_and_leaves_the_psf_at_its_wavelength():
    wave = wave_height(GREEN, RESIST)
    assert wave == pytest.approx(543e-9 / 0.6576, rel=0.01)  # n of S1813 at 543 nm is 1.657
    made = make(ramp(5.0), Fabrication(height_limit_um=1.2, wrap_wavelength_nm=543.0), RESIST, 0)
    assert float(made.max()) < 1.2e-6 and float(made.min()) >= 0
    waves = (ramp(5.0) - made) / wave
    assert torch.allclose(waves, waves.round(), atol=1e-9)
    smooth = {"mask": {"kind": "cubic"}, "psf": {"window_px": 32, "pupil_sampling_um": 5.0}}
    plain = psf_bank(camera(**smooth), [GREEN, 620e-9], [0.5]).values[0]
    wrapping = {"pitch_um": 5.0, "height_limit_um": 1.2, "wrap_wavelength_nm": 543.0}
    wrapped = psf_bank(camera(**smooth, fabrication=wrapping), [GREEN, 620e-9], [0.5]).values[0]
    change = (wrapped - plain).flatten(1).norm(dim=1) / plain.flatten(1).norm(dim=1)
    assert float(change[0]) < 1e-3  # nothing at the wavelength it is wrapped for
    assert float(change[1]) > 0.1  # much at another


def test_levels():
    made = make(ramp(1.2, 1000), Fabrication(levels=98, height_limit_um=1.2), RESIST, 0)
    assert len(made.unique()) == 98
    assert float((made - ramp(1.2, 1000)).abs().max()) <= 1.2e-6 / 97 / 2 * 1.0001
    coarse = make(ramp(1.0), Fabrication(levels=5, level_nm=100.0), RESIST, 0)
    assert float(coarse.max()) == pytest.approx(400e-9)


def test_height_error_has_its_mean_and_spread_and_follows_the_seed():
    fabrication = Fabrication(preset="paper-device", levels=None)
    flat = torch.zeros(400, 400, dtype=torch.float64)
    first, again, other = (make(flat, fabrication, RESIST, seed) for seed in (1, 1, 2))
    assert torch.equal(first, again) and not torch.equal(first, other)
    assert float(first.mean()) == pytest.approx(
        44e-9, abs=0.5e-9
    )  # Akpinar et al.: mean 44 nm, sigma 49.5 nm
    assert float(first.std()) == pytest.approx(49.5e-9, rel=0.01)
    single = make(flat.float(), fabrication, RESIST, 1)
    assert torch.allclose(single.double(), first, rtol=1e-5)


@pytest.mark.parametrize("stated", [None, 21.0, 10.0])
def test_height_errors_leave_what_goodman_says_whether_their_pitch_is_stated_or_not(stated):
    """Independent errors leave exp(-s^2) of the light where it was, s the standard deviation of the phase
    (Goodman, Statistical Optics, random phase screens): 0.812 for 60 nm, where 48.8 nm would leave 0.871."""
    making = {"height_noise_nm": 60.0, **({} if stated is None else {"pitch_um": stated})}
    how = {
        "mask": {"kind": "height-map", "pitch_um": 21.0},
        "psf": {"window_px": 16},
        "lens": {"kind": "ideal", "focal_length_mm": 50.0, "f_number": 10.0},
    }
    designed, made = camera(**how), camera(**how, fabrication=making)
    focus = [1 / designed.recipe.focus.distance_m]
    whole = float(psf_bank(designed, [GREEN], focus).values.max())
    left = [float(psf_bank(made, [GREEN], focus, seed=seed).values.max()) / whole for seed in range(4)]
    delay = 2 * math.pi * (float(RESIST.index(GREEN)) - 1) * 60e-9 / GREEN
    assert sum(left) / 4 == pytest.approx(math.exp(-(delay**2)), rel=0.01)


def test_a_preset_can_be_changed_key_by_key():
    changed = Fabrication(preset="paper-device", levels=50)
    assert (changed.levels, changed.height_limit_um, changed.pitch_um) == (50, 1.2, 3.0)


def test_a_deep_mask_without_wrapping_is_refused():
    with pytest.raises(InputError, match="wrap_wavelength_nm"):
        make(ramp(5.0), Fabrication(height_limit_um=1.2), RESIST, 0)
    with pytest.raises(InputError, match="below one wave"):
        make(ramp(5.0), Fabrication(height_limit_um=0.5, wrap_wavelength_nm=543.0), RESIST, 0)


def test_seed_of_the_bank_overrules_the_recipe():
    noisy = camera(
        mask={"kind": "height-map", "pitch_um": 100.0},
        fabrication={"height_noise_nm": 40.0, "seed": 1},
        psf={"window_px": 16},
    )
    by_recipe, same, other = (psf_bank(noisy, [GREEN], [0.5], seed=seed).values for seed in (None, 1, 2))
    assert torch.equal(by_recipe, same) and not torch.equal(by_recipe, other)


def test_made_surface_is_sampled_at_its_own_pitch():
    made = camera(mask={"kind": "cubic"}, fabrication={"preset": "paper-device", "wrap_wavelength_nm": 543.0})
    assert natural_samples(made, 3e-6) == 1667
    bank = psf_bank(made, [GREEN], [0.5], window_px=8)
    assert plan_sampling(made, bank.wavelengths, bank.inverse_depths, 8).pitch == pytest.approx(3e-6)
    # errors scatter 1 - exp(-(2 pi (n - 1) sigma / lambda)^2) of the light, almost all out of the window
    ideal = camera(mask={"kind": "cubic"})
    flat = psf_bank(ideal, [GREEN], [0.5], window_px=128)
    noisy = psf_bank(made, [GREEN], [0.5], window_px=128)
    delay = 2 * torch.pi * (float(RESIST.index(GREEN)) - 1) * 49.5e-9 / GREEN
    scattered = 1 - torch.exp(torch.tensor(-(delay**2)))
    assert float(noisy.truncated - flat.truncated) == pytest.approx(float(scattered), rel=0.1)


def test_finer_pupils_see_the_squares_that_were_made():
    making = {"pitch_um": 40.0, "height_noise_nm": 40.0}
    made = camera(mask={"kind": "height-map", "pitch_um": 40.0}, fabrication=making)
    coarse = surface(made, PupilGrid(125, 40e-6, 2.5e-3))
    fine = surface(made, PupilGrid(250, 20e-6, 2.5e-3))
    assert torch.equal(fine[::2, ::2], coarse) and torch.equal(fine[1::2, 1::2], coarse)


def test_height_maps_that_do_not_fit_are_refused(tmp_path):
    import numpy as np

    np.save(tmp_path / "large.npy", np.zeros((260, 260)))
    np.save(tmp_path / "small.npy", np.zeros((200, 200)))
    np.save(tmp_path / "oblong.npy", np.zeros((239, 200)))
    np.save(tmp_path / "broken.npy", np.full((239, 239), np.nan))
    np.save(tmp_path / "micrometres.npy", np.full((239, 239), 0.5))
    (tmp_path / "text.npy").write_text("not a map")
    write_height_map(tmp_path / "other.safetensors", torch.zeros(239, 239), 30)
    words = {
        "large.npy": "larger than the pupil",
        "small.npy": "does not cover the pupil",
        "oblong.npy": "square",
        "broken.npy": "not finite",
        "micrometres.npy": "0.5 m, more than 1 mm.*divide micrometres",
        "text.npy": "no file of NumPy's",
        "missing.npy": "does not exist",
        "other.safetensors": "sampled at 30 um",
    }
    for file, word in words.items():
        recipe = CameraRecipe(name="map", mask={"kind": "height-map", "file": file})
        with pytest.raises(InputError, match=word):
            psf_bank(Camera.from_recipe(recipe, tmp_path), [GREEN], [0.5])
    with pytest.raises(InputError, match="divide micrometres"):
        camera().with_height(torch.full((239, 239), -0.5))
    with pytest.raises(InputError, match="larger than the pupil"):
        psf_bank(camera(mask={"kind": "height-map"}).with_height(torch.zeros(300, 300)), [GREEN], [0.5])


def test_height_maps_keep_their_pitch_on_disk(tmp_path):
    height = torch.rand(5, 5, dtype=torch.float64) * 1e-6
    loaded, pitch = load_height_map(write_height_map(tmp_path / "map.safetensors", height, 21))
    assert torch.equal(loaded, height) and pitch == pytest.approx(21e-6)
