"""Gradients: the paper's formula, automatic differentiation, finite differences."""

from __future__ import annotations

import math

import pytest
import torch

from edofsim.optics import Camera, plan_sampling, propagation, psf_bank
from edofsim.optics.fabrication import make
from edofsim.optics.grid import PupilGrid
from edofsim.optics.materials import material
from edofsim.optics.propagation import Wave, energies, propagate
from edofsim.optics.pupil import chirp
from edofsim.optics.transform import SensorWindow, make_bases, pixel_weights
from edofsim.recipe.camera import CameraRecipe
from edofsim.recipe.fabrication import Fabrication

GREEN = 543e-9
CPU = torch.device("cpu")


def test_gradient_of_the_papers_appendix():
    # Eq. `partialEphi3`: dL/dPhi = 2 M N Im(F^-1(dL/dh o Q^) o Q*). With a sensor step of lambda z_i / (n ds)
    # and a window of n pixels the matrix transform is the discrete one, up to phases on the sensor
    n, reach = 21, GREEN * 0.0369
    grid = PupilGrid(n, 5e-3 / n, 2.5e-3)
    window = SensorWindow(n, reach / (n * grid.pitch), 1)
    bases = make_bases(grid, window, reach, 1.0, torch.float64, CPU)
    generator = torch.Generator().manual_seed(3)
    amplitude = (grid.radius_squared() <= grid.radius**2).double()
    phase = torch.randn(n, n, generator=generator, dtype=torch.float64).requires_grad_()
    weights = torch.randn(n, n, generator=generator, dtype=torch.float64)
    psi = torch.tensor([7.0], dtype=torch.float64)
    pupil = amplitude * torch.exp(1j * phase)
    energy = propagate([Wave(pupil, chirp(grid, psi, dtype=torch.float64), bases)])[0, 0]
    (energy * weights).sum().backward()

    q = (amplitude * torch.exp(1j * (phase + psi * grid.radius_squared() / grid.radius**2))).detach()
    spectrum = torch.fft.fftshift(torch.fft.ifft2(q)) * n * n  # +j, as pictures are turned upright
    # pixels of one sample: their end correction is circular here, the transform repeats every n samples
    ends = torch.zeros(n, n, dtype=torch.float64)
    for step, weight in ((0, 22 / 24), (1, 1 / 24), (-1, 1 / 24)):
        ends += weight * torch.eye(n, dtype=torch.float64).roll(step, 0)
    scale = float(q.abs().square().sum()) / float(energy.detach().sum()) * n * n
    assert torch.allclose(energy.detach() * scale, ends @ spectrum.abs() ** 2 @ ends, rtol=1e-9)
    by_energy = ends.T @ (weights / scale) @ ends  # dL/dh of the samples
    pulled = torch.fft.fft2(torch.fft.ifftshift(by_energy * spectrum))
    expected = 2 * torch.imag(pulled * q.conj())
    assert float((phase.grad - expected).norm() / expected.norm()) < 1e-8


def complex_energies(pupil, grid, window, reach, psi):
    """The same energies as one complex matrix product, for automatic differentiation."""
    step = window.pitch / window.oversampling
    sensor = (torch.arange(window.sub_pixels, dtype=torch.float64) - (window.sub_pixels - 1) / 2) * step
    basis = torch.exp(2j * math.pi / reach * torch.outer(sensor, grid.centres))
    defocus = torch.exp(1j * psi[:, None, None] * grid.radius_squared() / grid.radius**2)
    field = basis @ (pupil * defocus) @ basis.T * (grid.pitch * step / reach)
    weights = pixel_weights(window)[: window.pixels]
    return weights @ (field.abs() ** 2) @ weights.T


@pytest.mark.parametrize("samples", [40, 41])
@pytest.mark.parametrize(("pixels", "oversampling"), [(8, 2), (9, 1), (6, 1), (5, 3)])
@pytest.mark.parametrize("kept", [0, propagation.KEPT_BYTES])
def test_adjoint_by_hand_agrees_with_automatic_differentiation(
    samples, pixels, oversampling, kept, monkeypatch
):
    monkeypatch.setattr(propagation, "KEPT_BYTES", kept)
    monkeypatch.setattr(propagation, "BLOCK_BYTES", 1)  # every depth a block of its own
    torch.set_num_threads(3)  # and blocks are shared out among threads
    grid, reach = PupilGrid(samples, 5e-3 / samples, 2.5e-3), GREEN * 0.0369
    window = SensorWindow(pixels, 6e-6, oversampling)
    bases = make_bases(grid, window, reach, 1.0, torch.float64, CPU)
    generator = torch.Generator().manual_seed(5)
    pupil = torch.randn(samples, samples, generator=generator, dtype=torch.complex128).requires_grad_()
    psi = torch.tensor([-20.0, 0.0, 3.0], dtype=torch.float64)
    weights = torch.randn(3, pixels, pixels, generator=generator, dtype=torch.float64)
    wave = Wave(pupil, chirp(grid, psi, dtype=torch.float64), bases)
    mine = propagate([wave, wave])[:, 1, :pixels, :pixels]
    theirs = complex_energies(pupil, grid, window, reach, psi)
    assert torch.allclose(mine, theirs, rtol=1e-10)
    (by_hand,) = torch.autograd.grad((mine * weights).sum(), pupil)
    (automatic,) = torch.autograd.grad((theirs * weights).sum(), pupil)
    assert float((by_hand - automatic).norm() / automatic.norm()) < 1e-10


@pytest.mark.parametrize("samples", [40, 41])
@pytest.mark.parametrize(("pixels", "oversampling"), [(8, 2), (9, 1), (6, 1), (5, 3)])
def test_a_pupil_that_is_its_own_mirror_image_takes_a_quarter_of_the_work(
    samples, pixels, oversampling, monkeypatch
):
    grid, reach = PupilGrid(samples, 5e-3 / samples, 2.5e-3), GREEN * 0.0369
    window = SensorWindow(pixels, 6e-6, oversampling)
    bases = make_bases(grid, window, reach, 1.0, torch.float64, CPU)
    square = grid.radius_squared() / grid.radius**2
    pupil = (square <= 1) * torch.exp(3j * square**2)
    psi = torch.tensor([-20.0, 0.0, 3.0], dtype=torch.float64)
    wave = Wave(pupil, chirp(grid, psi, dtype=torch.float64), bases)
    with monkeypatch.context() as patch:  # the way that any pupil takes
        patch.setattr(propagation, "waves", None)
        mine = energies(wave)[:, :pixels, :pixels]
    assert torch.allclose(mine, complex_energies(pupil, grid, window, reach, psi), rtol=1e-10)
    pupil[3, 20] = 2.0  # one cell more: another way
    mine = energies(wave)[:, :pixels, :pixels]
    assert torch.allclose(mine, complex_energies(pupil, grid, window, reach, psi), rtol=1e-10)


FABRICATIONS = {
    "as designed": None,
    "noise": {"height_noise_nm": 40.0, "seed": 4},
    "upsampled, wrapped, noise": {
        "pitch_um": 5000 / 14,
        "height_limit_um": 1.2,
        "wrap_wavelength_nm": 543.0,
        "height_noise_nm": 30.0,
        "height_bias_nm": 10.0,
    },
}


@pytest.mark.parametrize("making", FABRICATIONS)
def test_gradcheck_through_height_fabrication_and_psf(making):
    recipe = CameraRecipe(
        name="small",
        lens={"aperture_radius_mm": 2.5},
        mask={"kind": "height-map", "pitch_um": 5000 / 7},
        fabrication=FABRICATIONS[making],
        psf={"window_px": 5, "oversampling": 2, "pupil_sampling_um": 100.0},
    )
    camera = Camera.from_recipe(recipe)
    generator = torch.Generator().manual_seed(2)
    start = torch.rand(7, 7, generator=generator, dtype=torch.float64) * 1.5  # um: deeper than the limit

    def bank(height_um):
        return psf_bank(
            camera.with_height(height_um * 1e-6), [GREEN, 611e-9], [0.85, 0.75], dtype=torch.float64
        ).values

    assert torch.autograd.gradcheck(bank, (start.requires_grad_(),), eps=1e-6, atol=1e-7, rtol=1e-4)


def test_quantising_passes_gradients_straight_through():
    """98 levels from 0 to 1.2 um are 1.2 um / 97 apart: heights above the lowest go to the nearest one."""
    fabrication = Fabrication(levels=98, height_limit_um=1.2)
    generator = torch.Generator().manual_seed(0)
    height = (torch.rand(9, 9, generator=generator, dtype=torch.float64) * 1.1e-6).requires_grad_()
    made = make(height, fabrication, material("S1813"), 0)
    weights = torch.randn(9, 9, generator=generator, dtype=torch.float64)
    (made * weights).sum().backward()
    assert torch.allclose(height.grad, weights)
    level = made.detach() / (1.2e-6 / 97)
    assert torch.allclose(level, level.round(), atol=1e-9)
    moved = (made - (height - height.min())).detach().abs()
    assert 0 < moved.max() <= 1.2e-6 / 97 / 2 * (1 + 1e-9)


def test_float32_training_gets_the_gradient_of_float64():
    camera = Camera.from_recipe(
        CameraRecipe(
            name="train", mask={"kind": "height-map"}, psf={"window_px": 64, "pupil_sampling_um": 21.0}
        )
    )
    generator = torch.Generator().manual_seed(0)
    start = torch.rand(239, 239, generator=generator, dtype=torch.float64) * 1e-6
    weights = torch.randn(64, 64, generator=generator, dtype=torch.float64)
    gradients = []
    for dtype in (torch.float64, torch.float32):
        height = start.clone().to(dtype).requires_grad_()
        bank = psf_bank(camera.with_height(height), [482e-9, 611e-9], [0.0, 2.0], dtype=dtype)
        (bank.values * weights.to(dtype)).sum().backward()
        gradients.append(height.grad.double())
    assert float((gradients[0] - gradients[1]).norm() / gradients[0].norm()) < 1e-4
    assert plan_sampling(camera, bank.wavelengths, bank.inverse_depths, 64).samples == 239
