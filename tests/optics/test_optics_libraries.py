"""The same pupils on the same grid, by prysm and by poppy."""

from __future__ import annotations

import math
import warnings

import numpy as np
import pytest
import torch

from edofsim.optics import Camera, defocus, psf_bank
from edofsim.optics.grid import PupilGrid, disc_amplitude, disc_coverage
from edofsim.recipe.camera import CameraRecipe

SAMPLES, PIXELS, OVERSAMPLING, ALPHA = 240, 48, 2, 30.0
WAVELENGTHS = (482e-9, 543e-9, 611e-9)
CASES = {
    "clear in focus": (0.0, None),
    "clear defocused": (2.0, None),
    "cubic": (0.7, ALPHA),
    "cubic far": (0.0, ALPHA),
}


def case(name: str, wavelength: float) -> tuple[Camera, float, np.ndarray]:
    """Camera, inverse depth, and the pupil function written out from its definition."""
    inverse_depth, alpha = CASES[name]
    mask = (
        {"kind": "clear"}
        if alpha is None
        else {"kind": "cubic", "alpha_rad": alpha, "design_wavelength_nm": 543.0}
    )
    pitch_um = 5000 / SAMPLES
    settings = {"window_px": PIXELS, "oversampling": OVERSAMPLING, "pupil_sampling_um": pitch_um}
    camera = Camera.from_recipe(CameraRecipe(name="both", mask=mask, psf=settings))
    radius, curvature = 2.5e-3, 16.51e-3
    grid = PupilGrid(SAMPLES, pitch_um * 1e-6, radius)
    s = (np.arange(SAMPLES) - (SAMPLES - 1) / 2) * grid.pitch
    right, up = s[None, :], -s[:, None]
    square = right**2 + up**2
    n = float(camera.lens.glasses()[0].index(wavelength))
    k = 2 * math.pi / wavelength
    # the exact lens against its parabola, by plain subtraction in double precision
    lens = -k * (n - 1) * (curvature - np.sqrt(curvature**2 - square) - square / (2 * curvature))
    phase = lens + float(defocus(camera, wavelength, inverse_depth)) * square / radius**2
    if alpha is not None:
        height_map = camera.mask_material.index(torch.tensor([wavelength, 543e-9], dtype=torch.float64))
        scale = 543e-9 / wavelength * float((height_map[0] - 1) / (height_map[1] - 1))
        phase = phase + alpha * scale * ((right / radius) ** 3 + (up / radius) ** 3)
    return camera, inverse_depth, disc_amplitude(grid, radius).numpy() * np.exp(1j * phase)


def ours(camera: Camera, wavelength: float, inverse_depth: float) -> torch.Tensor:
    return psf_bank(camera, [wavelength], [inverse_depth]).values[0, 0].double()


def pixels(field: np.ndarray) -> torch.Tensor:
    """Pixels of a field sampled at sub-pixels, one more on each side: midpoint rule with end correction."""
    samples = np.abs(field) ** 2
    for _ in (0, 1):
        own = samples[1:-1].reshape(PIXELS, OVERSAMPLING, -1).sum(1)
        ends = samples[:-2:2] - samples[1:-1:2] + samples[3::2] - samples[2:-1:2]
        samples = (own + ends / 24).T
    return torch.from_numpy(np.ascontiguousarray(samples))


every_case = pytest.mark.parametrize("name", CASES)
every_wavelength = pytest.mark.parametrize("wavelength", WAVELENGTHS)


@every_case
@every_wavelength
def test_prysm(name, wavelength):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        from prysm.propagation import focus_fixed_sampling
    camera, inverse_depth, pupil = case(name, wavelength)
    step = camera.pixel / OVERSAMPLING
    count = PIXELS * OVERSAMPLING + 2
    # millimetres, microns; the sensor as the scene sees it is the picture turned by half a turn. prysm puts a
    # sample on the axis, pixels meet there: half a sample of shift, in its unit
    field = focus_fixed_sampling(
        pupil[::-1, ::-1],
        5.0 / SAMPLES,
        camera.sensor_distance * 1e3,
        wavelength * 1e6,
        step * 1e6,
        count,
        shift=(step * 1e6 / 2, step * 1e6 / 2),
    )
    theirs = pixels(field)
    mine = ours(camera, wavelength, inverse_depth)
    # its transform keeps energy too, up to the light that the edge scatters beyond its replica
    theirs = theirs * (mine.sum() / theirs.sum())
    assert float((mine - theirs).norm() / theirs.norm()) < 1e-3


@every_case
@every_wavelength
def test_poppy(name, wavelength):
    from poppy.matrixDFT import matrix_dft

    camera, inverse_depth, pupil = case(name, wavelength)
    count = PIXELS * OVERSAMPLING + 2
    # a window of so many lambda / D, an even one half a pixel off; poppy's sign turns pictures upright too
    elements = camera.pixel / OVERSAMPLING * count * 5e-3 / (wavelength * camera.sensor_distance)
    shift = OVERSAMPLING / 2
    field = matrix_dft(pupil, elements, count, offset=(shift, shift), centering="ADJUSTABLE")
    grid = PupilGrid(SAMPLES, 5e-3 / SAMPLES, 2.5e-3)
    # poppy keeps energy: the sum over all of the plane is that over the pupil
    scale = 1 / float(disc_coverage(grid, 2.5e-3).sum())
    theirs = pixels(field) * scale
    mine = ours(camera, wavelength, inverse_depth)
    assert float((mine - theirs).norm() / theirs.norm()) < 1e-3
