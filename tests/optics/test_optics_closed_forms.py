"""PSFs and transfer functions against formulas."""

from __future__ import annotations

import math
import subprocess
import sys
from collections.abc import Sequence

import pytest
import torch
from scipy.special import j1, jv
from torch import Tensor

from edofsim.optics import Camera, defocus, focus_distance, psf_bank
from edofsim.optics.camera import cutoff_frequency
from edofsim.optics.grid import PupilGrid, disc_coverage
from edofsim.optics.mtf import _focal_planes, mtf, otf, strehl
from edofsim.recipe.camera import CameraRecipe

GREEN = 543e-9


def ideal(mask: dict | None = None, **psf) -> Camera:
    """The paper's lens as a parabola: without spherical aberration, closed forms hold."""
    recipe = CameraRecipe(
        name="ideal",
        lens={"surface_profile": "parabolic"},
        mask=mask or {"kind": "clear"},
        sensor={"pixel_um": psf.pop("pixel_um", 6.0)},
        psf=psf,
    )
    return Camera.from_recipe(recipe)


def in_focus(camera: Camera, wavelength: float = GREEN) -> float:
    return 1 / float(focus_distance(camera, wavelength))


def at_defocus(camera: Camera, psi: float, wavelength: float = GREEN) -> float:
    """Inverse depth at which a wavelength has a given Psi."""
    slope = math.pi / wavelength * camera.aperture_radius**2
    return (psi - float(defocus(camera, wavelength, 0.0))) / slope


def integrated(samples: torch.Tensor, oversampling: int) -> torch.Tensor:
    """Pixels from samples at sub-pixel centres, one more on each side: midpoint rule with end correction."""
    for _ in (0, 1):
        pixels = []
        for start in range(1, len(samples) - 1, oversampling):
            end = start + oversampling
            ends = samples[start - 1] - samples[start] + samples[end] - samples[end - 1]
            pixels.append(samples[start:end].sum(0) + ends / 24)
        samples = torch.stack(pixels).T
    return samples


def pixel_centres(count: int, pitch: float) -> torch.Tensor:
    return (torch.arange(count, dtype=torch.float64) - count // 2) * pitch


@pytest.mark.parametrize("wavelength", [450e-9, 543e-9, 650e-9])
def test_airy_pattern(wavelength):
    # I = (pi r^2 / (lambda z_i))^2 (2 J1(v) / v)^2 / (pi r^2), light through the pupil = 1 (Goodman, 4.4.2)
    camera = ideal(pixel_um=0.8, window_px=65, oversampling=1)
    bank = psf_bank(camera, [wavelength], [in_focus(camera, wavelength)], dtype=torch.float64)
    x = pixel_centres(67, 0.8e-6)
    distance = torch.sqrt(x[:, None] ** 2 + x[None, :] ** 2)
    v = 2 * math.pi * camera.aperture_radius * distance / (wavelength * camera.sensor_distance)
    airy = torch.where(v > 0, (2 * torch.from_numpy(j1(v.numpy())) / v.clamp_min(1e-12)) ** 2, 1.0)
    peak = math.pi * (camera.aperture_radius / (wavelength * camera.sensor_distance)) ** 2
    expected = integrated(airy * peak * 0.8e-6**2, 1)
    assert float((bank.values[0, 0] - expected).abs().max()) < 1e-3 * float(expected.max())


@pytest.mark.parametrize("psi", [0.0, 8.0, -25.0])
def test_gaussian_pupil(psi):
    # the transform of exp(-rho^2 (1/w^2 - j Psi)) is a Gaussian too; r, w in pupil radii
    waist = 0.2
    camera = ideal({"kind": "gaussian", "waist": waist}, pixel_um=2.0, window_px=96, oversampling=2)
    bank = psf_bank(camera, [GREEN], [at_defocus(camera, psi)], dtype=torch.float64)
    width = 1 / waist**2 - 1j * psi
    step = 1e-6
    x = (torch.arange(194, dtype=torch.float64) - 97.5) * step
    nu = x * camera.aperture_radius / (GREEN * camera.sensor_distance)
    profile = torch.exp(-2 * math.pi**2 * nu**2 * (1 / width).real)
    peak = (math.pi / abs(width)) ** 2 / (math.pi * waist**2 / 2)
    scale = peak * (step * camera.aperture_radius / (GREEN * camera.sensor_distance)) ** 2
    expected = integrated(profile[:, None] * profile[None, :] * scale, 2)
    assert float((bank.values[0, 0] - expected).norm() / expected.norm()) < 1e-6


def test_pixels_integrate_the_intensity():
    # a Gaussian over a pixel is a difference of error functions; the error of the rule falls as 1 / n^4
    waist = 0.25
    errors = []
    for oversampling in (2, 4, 8):
        camera = ideal({"kind": "gaussian", "waist": waist}, window_px=16, oversampling=oversampling)
        bank = psf_bank(camera, [GREEN], [in_focus(camera)], dtype=torch.float64)
        sigma = GREEN * camera.sensor_distance / (2 * math.pi * waist * camera.aperture_radius)
        edges = (torch.arange(17, dtype=torch.float64) - 8.5) * camera.pixel
        share = torch.erf(edges / (sigma * math.sqrt(2))).diff() / 2
        expected = share[:, None] * share[None, :]
        errors.append(float((bank.values[0, 0] - expected).norm() / expected.norm()))
    assert errors[0] < 1e-2 and errors[2] < 1e-5
    assert errors[0] / errors[1] == pytest.approx(16, rel=0.25)
    assert errors[1] / errors[2] == pytest.approx(16, rel=0.25)


@pytest.mark.parametrize("angle", [0.0, 27.0, 90.0, -60.0])
def test_diffraction_limited_mtf(angle):
    camera = ideal()
    cutoff = cutoff_frequency(camera, GREEN)
    assert cutoff == pytest.approx(250e3, rel=5e-3)
    s = torch.linspace(0, 1.1, 45, dtype=torch.float64)
    x = s.clamp_max(1)
    expected = 2 / math.pi * (torch.acos(x) - x * torch.sqrt(1 - x * x))  # Goodman, Eq. 6-32
    found = mtf(camera, GREEN, [in_focus(camera)], s * cutoff, angle_deg=angle)[0]
    assert float((found - expected).abs().max()) < 1e-3


def hopkins(psi: float, s: float) -> float:
    """OTF of a defocused circular pupil at s = 2 f / cut-off, Hopkins, Proc. R. Soc. A 231, 91 (1955)."""
    a = 2 * psi * s
    beta = math.acos(s / 2)
    first = beta * jv(1, a)
    second = 0.0
    for n in range(1, 200):
        first += (-1) ** (n + 1) * math.sin(2 * n * beta) / (2 * n) * (jv(2 * n - 1, a) - jv(2 * n + 1, a))
    for n in range(200):
        second += (-1) ** n * math.sin((2 * n + 1) * beta) / (2 * n + 1) * (jv(2 * n, a) - jv(2 * n + 2, a))
    half = a * s / 2
    return 4 / (math.pi * a) * (math.cos(half) * first - math.sin(half) * second)


@pytest.mark.parametrize("psi", [2.0, 10.0, -30.0])
def test_defocused_otf_of_hopkins(psi):
    camera = ideal()
    s = torch.linspace(0.02, 1.5, 60, dtype=torch.float64)
    expected = torch.tensor([hopkins(psi, float(x)) for x in s], dtype=torch.float64)
    found = otf(camera, GREEN, [at_defocus(camera, psi)], s / 2 * cutoff_frequency(camera, GREEN))[0]
    assert float((found.real - expected).abs().max()) < 1e-3
    assert float(found.imag.abs().max()) < 1e-3


@pytest.mark.parametrize("psi", [1.0, 4.0, -7.0])
def test_strehl_ratio_on_axis(psi):
    camera = ideal()
    found = strehl(camera, [GREEN], [at_defocus(camera, psi)], on_axis=True)
    assert float(found) == pytest.approx((math.sin(psi / 2) / (psi / 2)) ** 2, abs=1e-3)  # Born & Wolf, 8.8


def test_strehl_ratio_of_weak_aberration_follows_its_variance():
    # Marechal: S = exp(-sigma^2); Zernike terms have unit RMS
    terms = [{"noll": 6, "rms_rad": 0.2}, {"noll": 11, "rms_rad": 0.1}]
    camera = ideal({"kind": "zernike", "terms": terms, "design_wavelength_nm": GREEN * 1e9})
    found = strehl(camera, [GREEN], [in_focus(camera)])
    assert float(found) == pytest.approx(math.exp(-(0.2**2) - 0.1**2), abs=2e-3)


def encircled_energy(psfs: Tensor, radii_px: Tensor | Sequence[float]) -> Tensor:
    """Energy of each PSF within circles around its centre pixel's middle, [..., radius].

    psfs: [..., y, x] as `PsfField.values`, so that what lies outside the window counts as light too; radii in
    pixels. Pixels that a circle crosses count with the part that is inside.
    """
    size = psfs.shape[-1]
    grid = PupilGrid(size + 1 - size % 2, 1.0, 1.0)
    inside = torch.stack([disc_coverage(grid, float(radius))[:size, :size] for radius in radii_px])
    return torch.einsum("...yx,ryx->...r", psfs, inside.to(psfs))


def test_encircled_energy_of_the_airy_pattern():
    camera = ideal(pixel_um=0.5, window_px=121, oversampling=1)
    bank = psf_bank(camera, [GREEN], [in_focus(camera)], dtype=torch.float64)
    radii = torch.tensor([8.0, 9.8, 20.0, 50.0])
    v = 2 * math.pi * camera.aperture_radius * radii * 0.5e-6 / (GREEN * camera.sensor_distance)
    expected = 1 - torch.special.bessel_j0(v) ** 2 - torch.special.bessel_j1(v) ** 2  # Rayleigh
    found = encircled_energy(bank.values[0, 0], radii).to(expected)
    assert torch.allclose(found, expected, atol=5e-3)


def test_energy_outside_the_window():
    # light in a square of width w is the integral of OTF(f) w^2 sinc(w fx) sinc(w fy), OTF in closed form
    camera = ideal(window_px=21, oversampling=4)
    bank = psf_bank(camera, [GREEN], [in_focus(camera)], dtype=torch.float64)
    width = 21 * camera.pixel
    cutoff = cutoff_frequency(camera, GREEN)
    f = torch.linspace(-cutoff, cutoff, 2001, dtype=torch.float64)
    x = (torch.sqrt(f[:, None] ** 2 + f[None, :] ** 2) / cutoff).clamp_max(1)
    transfer = 2 / math.pi * (torch.acos(x) - x * torch.sqrt(1 - x * x))
    square = width * torch.sinc(width * f)
    inside = float(square @ transfer @ square) * float(f[1] - f[0]) ** 2
    assert float(bank.truncated) == pytest.approx(1 - inside, abs=1e-4)
    assert 1 - inside > 0.01  # else the check says nothing


def test_through_focus_mtf_is_highest_in_focus():
    camera = ideal()
    focus = in_focus(camera)
    depths = focus + torch.linspace(-0.5, 0.5, 7, dtype=torch.float64)
    curve = mtf(camera, GREEN, depths, [40e3])[:, 0]
    assert int(curve.argmax()) == 3
    assert torch.allclose(curve, curve.flip(0), atol=1e-3)


def test_pixel_transfer_function_is_a_sinc():
    camera = ideal()
    frequencies = torch.tensor([10e3, 50e3, 80e3], dtype=torch.float64)
    bare = otf(camera, GREEN, [in_focus(camera)], frequencies, angle_deg=0)
    seen = otf(camera, GREEN, [in_focus(camera)], frequencies, angle_deg=0, with_pixel=True)
    assert torch.allclose((seen / bare).real[0], torch.sinc(frequencies * camera.pixel), atol=1e-12)


def test_transfer_functions_in_parts_are_those_of_the_whole(monkeypatch):
    # the same sums, in another order: only rounding may differ
    camera = ideal({"kind": "cubic"})
    depths, frequencies = [0.3, 1.1], torch.tensor([0.0, 11e3, 70e3])
    whole = otf(camera, GREEN, depths, frequencies, angle_deg=30.0)
    on_axis = strehl(camera, [GREEN], depths, on_axis=True)
    largest = strehl(camera, [GREEN], depths)
    # along x the sum over the rows of the pupil takes the place of that over the sensor's
    level = otf(camera, GREEN, depths, frequencies)
    assert torch.allclose(otf(camera, GREEN, depths, frequencies, angle_deg=1e-9), level, atol=1e-9)
    monkeypatch.setattr("edofsim.optics.mtf.BLOCK_BYTES", 4 << 20)
    assert torch.allclose(otf(camera, GREEN, depths, frequencies), level, atol=1e-9)
    assert torch.allclose(otf(camera, GREEN, depths, frequencies, angle_deg=30.0), whole, atol=1e-9)
    assert torch.allclose(strehl(camera, [GREEN], depths, on_axis=True), on_axis, rtol=1e-9)
    # found on a finer grid around the brightest samples
    assert torch.allclose(strehl(camera, [GREEN], depths), largest, rtol=0.03)


@pytest.mark.parametrize("block, apart", [(256 << 20, 1e-9), (4 << 20, 0.03)])
def test_a_quadrant_tells_all_of_an_even_field(monkeypatch, block: int, apart: float):
    # the same sums by cosine transforms as by those of the whole; peaks of a large pupil are looked for
    # around the brightest samples, four of which are one in a quadrant
    camera = ideal({"kind": "annular"})
    depths, frequencies = [0.3, 1.1], torch.tensor([0.0, 11e3, 70e3])
    monkeypatch.setattr("edofsim.optics.mtf.BLOCK_BYTES", block)
    slanted = otf(camera, GREEN, depths, frequencies, angle_deg=30.0)
    largest = strehl(camera, [GREEN], depths)
    monkeypatch.setattr("edofsim.optics.mtf.MIRRORED", -1.0)
    assert torch.allclose(otf(camera, GREEN, depths, frequencies, angle_deg=30.0), slanted, atol=1e-9)
    assert torch.allclose(strehl(camera, [GREEN], depths), largest, rtol=apart)


def test_vertical_frequencies_are_those_of_columns():
    # coma along y alone: the sum over the columns of the pupil takes the place of that over the sensor
    camera = ideal({"kind": "zernike", "terms": [{"noll": 7, "rms_rad": 1.2}]})
    at = ([0.3, 1.1], torch.tensor([0.0, 11e3, 70e3]))
    vertical = otf(camera, GREEN, *at, angle_deg=90.0)
    assert torch.allclose(otf(camera, GREEN, *at, angle_deg=90.0 + 1e-9), vertical, atol=1e-9)
    assert not torch.allclose(otf(camera, GREEN, *at), vertical, atol=1e-3)


def test_each_depth_of_a_large_pupil_is_sampled_as_it_needs(monkeypatch):
    # on the axis (sin(Psi / 2) / (Psi / 2))^2 (Born and Wolf, Principles of Optics, section 8.8), and
    # Hopkins' overlap of two discs (Proc. R. Soc. A 231, 91, 1955)
    monkeypatch.setattr("edofsim.optics.mtf.LARGE_PUPIL", 600)
    camera, psis = ideal(), math.pi * torch.tensor([9.0, 25.0, 95.0], dtype=torch.float64)
    depths = torch.tensor([at_defocus(camera, float(psi)) for psi in psis], dtype=torch.float64)
    samples = [len(plane.pupil) for plane, _ in _focal_planes(camera, GREEN, depths)]
    assert samples[0] == samples[1] == 512 and 700 < samples[2] < 800  # 1536 by the paper's bound
    on_axis = strehl(camera, [GREEN], depths, on_axis=True)[:, 0]
    assert torch.allclose(on_axis, torch.sinc(psis / (2 * math.pi)) ** 2, rtol=0.02)
    shift = torch.tensor([0.01, 0.1, 0.7], dtype=torch.float64)  # of the discs, in radii
    x = (torch.arange(200000, dtype=torch.float64) + 0.5) / 200000 * (1 - shift[:, None] / 2)
    chords = torch.sqrt(1 - (x + shift[:, None] / 2) ** 2) * (1 - shift[:, None] / 2) * 4 / math.pi
    expected = [(torch.cos(2 * float(psi) * shift[:, None] * x) * chords).mean(1).abs() for psi in psis]
    frequencies = shift / 2 * cutoff_frequency(camera, GREEN)
    for angle in (0.0, 45.0, 90.0):
        found = mtf(camera, GREEN, depths, frequencies, angle_deg=angle)
        assert torch.allclose(found, torch.stack(expected), atol=1e-3)  # the light beyond the replica period


@pytest.mark.slow
def test_memory_of_transfer_functions_does_not_grow_with_the_lens():
    # f/2, 50 mm: 16 times as many samples each way as the paper's lens; whole fields would take 10 GiB each
    text = """
from pathlib import Path
from edofsim.optics import Camera
from edofsim.optics.mtf import mtf
from edofsim.recipe.camera import CameraRecipe
lens = {"radius_of_curvature_mm": 22.92, "aperture_radius_mm": 12.5, "thickness": "parabolic"}
recipe = CameraRecipe(name="f2", lens=lens, focus={"distance_m": 2.0}, psf={"window_px": 64})
camera = Camera.from_recipe(recipe)
mtf(camera, 543e-9, [0.0, 0.4], [0.0, 20e3])
status = Path("/proc/self/status").read_text()  # of this program: `ru_maxrss` knows what started it, too
print(int(status.split("VmHWM:")[1].split()[0]) / 1024)
"""
    done = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, check=True)
    assert float(done.stdout) < 1024
