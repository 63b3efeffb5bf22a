"""What every mask of the registry must do, and what each formula says."""

from __future__ import annotations

import json
import math

import pytest
import torch
from safetensors.torch import save_file

from edofsim.optics import Camera, levin, psf_bank
from edofsim.optics.grid import PupilGrid, disc_amplitude, disc_coverage
from edofsim.optics.height import design_phase_to_height, load_height_map, surface
from edofsim.optics.masks import catalogue, mask_amplitude
from edofsim.optics.masks.cubic import CubicMask
from edofsim.optics.masks.fourier import FourierMask
from edofsim.optics.masks.logarithmic import LogarithmicMask
from edofsim.optics.masks.rings import RingsMask
from edofsim.optics.masks.sinusoidal import SinusoidalMask
from edofsim.optics.masks.tangent import TangentMask
from edofsim.optics.pupil import transmission
from edofsim.optics.zernike import noll_orders, zernike
from edofsim.recipe.camera import CameraRecipe

ENTRIES = catalogue()
GREEN = 543e-9
BANDS = torch.linspace(420e-9, 720e-9, 31, dtype=torch.float64)
every_mask = pytest.mark.parametrize("entry", ENTRIES, ids=[entry.kind for entry in ENTRIES])


def camera(mask, **recipe) -> Camera:
    return Camera.from_recipe(CameraRecipe(name="mask", mask=mask, **recipe))


def test_the_registry_holds_the_masks_of_the_literature():
    kinds = {entry.kind for entry in ENTRIES}
    assert kinds >= {
        "clear", "annular", "cubic", "logarithmic", "sinusoidal", "tangent", "coded", "rings", "zernike",
        "fourier", "height-map",
    }  # fmt: skip
    for entry in ENTRIES:
        assert entry.summary
        assert entry.kind == "clear" or any(mark in entry.reference for mark in ("(1", "(2", "et al"))


@every_mask
def test_energy_in_the_window_and_outside_is_all_energy(entry):
    bank = psf_bank(camera(entry.example), BANDS[::6], [0.0, 0.7, 2.0], window_px=96)
    assert bool(torch.isfinite(bank.values).all()) and bool((bank.values >= 0).all())
    assert torch.allclose(bank.values.sum((-1, -2)) + bank.truncated, torch.ones(3, 6), atol=1e-4)
    assert bool((bank.truncated > -1e-4).all()) and bool((bank.truncated < 0.2).all())
    assert 0 < transmission(camera(entry.example)) <= 1


@every_mask
def test_light_outside_agrees_with_a_finer_pupil(entry):
    # masks with edges inside the pupil scatter more, and are known less well
    edges = {"coded": 5e-4, "rings": 6e-4, "annular": 3e-4, "height-map": 2e-4}
    coarse = psf_bank(camera(entry.example), [600e-9], [0.0, 2.0], window_px=96)
    fine = psf_bank(camera(entry.example, psf={"pupil_sampling_um": 7.0}), [600e-9], [0.0, 2.0], window_px=96)
    assert torch.allclose(coarse.truncated, fine.truncated, atol=edges.get(entry.kind, 1e-4))
    difference = (coarse.values - fine.values).norm() / fine.values.norm()
    assert float(difference) < 3e-3


@every_mask
def test_turning_the_relief_turns_the_psf(entry):
    grid = PupilGrid(101, 5e-3 / 101, 2.5e-3)
    height_map = surface(camera(entry.example), grid)
    if height_map is None:
        pytest.skip("blocks light only")
    clear = camera({"kind": "clear"})
    kept = {"window_px": 41, "dtype": torch.float64}
    plain = psf_bank(clear.with_height(height_map), [GREEN], [0.9], **kept).values
    for axis in (0, 1):
        turned = psf_bank(clear.with_height(height_map.flip(axis)), [GREEN], [0.9], **kept).values
        assert torch.allclose(turned, plain.flip(axis - 2), atol=1e-12)


@every_mask
def test_masks_are_differentiable_through_a_height_map(entry):
    seen = camera(entry.example, psf={"window_px": 24})
    height = (
        torch.rand(64, 64, generator=torch.Generator().manual_seed(1), dtype=torch.float64) * 1e-7
    ).requires_grad_()
    clear = camera({"kind": "clear"}, psf={"window_px": 24})
    values = psf_bank(clear.with_height(height), [GREEN], [0.5]).values
    values[0, 0, 12, 12].backward()
    assert bool(torch.isfinite(height.grad).all()) and float(height.grad.abs().max()) > 0
    assert not psf_bank(seen, [GREEN], [0.5]).values.requires_grad


@every_mask
def test_recipes_survive_json(entry):
    recipe = CameraRecipe(name="mask", mask=entry.example)
    assert CameraRecipe.model_validate_json(recipe.model_dump_json()) == recipe


@every_mask
def test_saved_and_loaded_reliefs_give_the_same_psfs(entry, tmp_path):
    seen = camera(entry.example, psf={"window_px": 32, "pupil_sampling_um": 5000 / 256})
    grid = PupilGrid(256, 5e-3 / 256, 2.5e-3)
    height_map = surface(seen, grid)
    if height_map is None:
        pytest.skip("blocks light only")
    about = {"edofsim": json.dumps({"pitch_um": grid.pitch * 1e6})}
    save_file({"height_m": height_map.contiguous()}, tmp_path / "relief.safetensors", about)
    loaded, pitch = load_height_map(tmp_path / "relief.safetensors")
    assert torch.equal(loaded, height_map) and pitch == pytest.approx(grid.pitch, rel=1e-12)
    material = entry.example.material
    mask = {"kind": "height-map", "file": "relief.safetensors", "pitch_um": pitch * 1e6, "material": material}
    recipe = CameraRecipe(name="loaded", mask=mask, psf=seen.recipe.psf)
    again = Camera.from_recipe(recipe, tmp_path)
    first, second = (psf_bank(c, [GREEN], [0.4], dtype=torch.float64).values for c in (seen, again))
    # steps become one cell wide when they are a height map
    assert float((first - second).norm() / first.norm()) < (0.1 if entry.kind == "rings" else 1e-9)


@every_mask
def test_masks_are_the_same_on_every_device(entry):
    devices = ["cpu"] + (["cuda"] if torch.cuda.is_available() else [])
    banks = [
        psf_bank(camera(entry.example), [GREEN], [0.3], window_px=32, device=d).values.cpu() for d in devices
    ]
    for bank in banks:
        assert torch.allclose(bank, banks[0], atol=1e-6)


def on_axis(mask, **changes):
    """Phase along u and v at the middle row and column of a fine grid."""
    grid = PupilGrid(401, 2 / 401, 1.0)
    phase = mask.model_copy(update=changes).phase(grid)
    u, v = grid.normalised()
    return u[0], v[:, 0], phase


def test_phases_follow_their_formulas():
    a, b = 7.0, 0.6
    u, v, phase = on_axis(CubicMask(), alpha_rad=a)
    assert torch.allclose(phase, a * (u[None] ** 3 + v[:, None] ** 3))
    u, v, phase = on_axis(SinusoidalMask(), alpha_rad=a, beta_rad=b)
    assert torch.allclose(phase[200], a * u**4 * torch.sin(b * u), atol=1e-12)
    u, v, phase = on_axis(TangentMask(), alpha_rad=a, beta_rad=b)
    assert torch.allclose(phase[:, 200], a * v**2 * torch.tan(b * v), atol=1e-12)
    u, v, phase = on_axis(LogarithmicMask(), alpha_rad=a, beta=b)
    expected = a * u.sign() * u**2 * (torch.log(u.abs().clamp_min(1e-300)) + b)
    assert torch.allclose(phase[200], expected, atol=1e-12)
    u, v, phase = on_axis(FourierMask(terms=[{"p": 2, "q": -1, "cosine_rad": 3.0, "sine_rad": 1.5}]))
    angle = math.pi * (2 * u[None] - v[:, None])
    assert torch.allclose(phase, 3.0 * torch.cos(angle) + 1.5 * torch.sin(angle), atol=1e-12)


def test_phase_scales_with_dispersion_not_with_wavelength_alone():
    # Akpinar et al., Eq. `phi0tophi`: Phi = Phi_0 lambda_0 (n - 1) / (lambda (n_0 - 1))
    from edofsim.optics.pupil import mask_delay

    seen = camera(CubicMask(design_wavelength_nm=543))
    blue = mask_delay(seen, 450e-9) * design_phase_to_height(seen, 1.0)
    n = seen.mask_material.index(torch.tensor([450e-9, 543e-9], dtype=torch.float64))
    assert blue == pytest.approx(float(543 / 450 * (n[0] - 1) / (n[1] - 1)), rel=1e-12)
    assert blue != pytest.approx(543 / 450, rel=0.02)


def test_zernike_polynomials_are_orthonormal():
    grid = PupilGrid(201, 2 / 201, 1.0)
    u, v = grid.normalised()
    light = disc_coverage(grid, 1.0).flatten() / disc_coverage(grid, 1.0).sum()
    basis = torch.stack([zernike(index, u, v).flatten() for index in range(1, 23)])
    assert torch.allclose((basis * light) @ basis.T, torch.eye(22, dtype=torch.float64), atol=4e-3)


def test_noll_order():
    # R. J. Noll, J. Opt. Soc. Am. 66, 207 (1976), table I
    table = {
        1: (0, 0),
        2: (1, 1),
        3: (1, -1),
        4: (2, 0),
        5: (2, -2),
        6: (2, 2),
        7: (3, -1),
        8: (3, 1),
        9: (3, -3),
    }
    table |= {
        10: (3, 3),
        11: (4, 0),
        12: (4, 2),
        13: (4, -2),
        14: (4, 4),
        15: (4, -4),
        22: (6, 0),
        37: (8, 0),
    }
    assert {index: noll_orders(index) for index in table} == table


def test_transmission_is_the_open_area():
    assert transmission(camera({"kind": "annular", "inner_radius": 0.6})) == pytest.approx(1 - 0.36, abs=1e-3)
    assert transmission(camera({"kind": "coded", "pattern": ["10", "01"]})) == pytest.approx(0.5, abs=1e-3)
    waist = 0.5  # light through exp(-2 rho^2 / w^2)
    expected = waist**2 / 2 * (1 - math.exp(-2 / waist**2))
    assert transmission(camera({"kind": "gaussian", "waist": waist})) == pytest.approx(expected, abs=1e-3)


def test_aperture_edges_are_grey_and_hold_the_area():
    for samples in (33, 64, 201):
        grid = PupilGrid(samples, 2.2 / samples, 1.0)
        covered = disc_coverage(grid, 1.0)
        assert bool(((covered > 0.01) & (covered < 0.99)).any())
        assert float(covered.sum()) * grid.pitch**2 == pytest.approx(math.pi, rel=2e-4)
        assert float(disc_amplitude(grid, 1.0).sum()) * grid.pitch**2 == pytest.approx(math.pi, rel=2e-4)


def test_slopes_of_smooth_masks():
    assert CubicMask(alpha_rad=30.0).slope() == pytest.approx(90.0, rel=0.01)
    assert RingsMask().slope() == 0


def test_coded_pattern_has_its_first_row_on_top():
    grid = PupilGrid(60, 2 / 60, 1.0)
    from edofsim.optics.masks.coded import CodedMask

    _, light = mask_amplitude(CodedMask(pattern=("10", "00")), grid)
    assert float(light[:30, :30].sum()) == pytest.approx(float(light.sum()))


SHIPPED = torch.tensor([[float(cell) for cell in row] for row in levin.PATTERN], dtype=torch.float64)


def test_levins_pattern_tells_blurs_apart():
    generator = torch.Generator().manual_seed(99)
    others = max(levin.discrimination(levin.random_pattern(generator)) for _ in range(20))
    axis = (torch.arange(13) - 6) / 6.5
    disc = ((axis[:, None] ** 2 + axis[None, :] ** 2) <= 1).double()
    assert levin.discrimination(SHIPPED) > 1.5 * others
    assert levin.discrimination(SHIPPED) > 2 * levin.discrimination(disc)


@pytest.mark.slow
def test_levins_pattern_is_what_the_search_finds():
    assert levin.discrimination(levin.search(0)) == pytest.approx(levin.discrimination(SHIPPED), rel=0.05)
