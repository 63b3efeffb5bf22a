"""What rays say of a lens over its field, against closed forms of thin lenses and against PSFs."""

from __future__ import annotations

import math

import pytest
import torch

from edofsim.optics import Camera, psf_bank
from edofsim.optics.lenses.prescription import PrescriptionLens
from edofsim.optics.mtf import mtf, tangential_sagittal
from edofsim.optics.prescription.spots import foci, heights, spots
from edofsim.recipe.load import load_camera

GREEN = 550e-9
INDEX = 1.5


def thin(stop_mm: float = 0.0, f_number: float = 50.0, **keys) -> PrescriptionLens:
    """A lens of 500 mm, its stop so far in front."""
    glass = {"nd": INDEX, "vd": 60.0}
    surfaces = (
        {"stop": True, "thickness_mm": stop_mm},
        {"radius_mm": 500.0, "thickness_mm": 0.1, **glass},
        {"radius_mm": -500.0},
    )
    return PrescriptionLens(kind="prescription", surfaces=surfaces, f_number=f_number, **keys)


def test_the_foci_of_a_thin_lens_are_those_of_third_order():
    """With its stop at it: the sagittal focus lies y'^2 (1 + 1/n) / 2f before the plane, the tangential one
    y'^2 (3 + 1/n) / 2f (Welford, Aberrations of Optical Systems, 12.4)."""
    held = thin().held()
    tangents = torch.tensor([0.0, 0.03, 0.06], dtype=torch.float64)
    tangential, sagittal = foci(held, tangents, held.wavelength, math.inf)
    assert tangential[0] == pytest.approx(0, abs=1e-4) and sagittal[0] == pytest.approx(0, abs=1e-4)
    sag = (tangents * held.first.focal).square() / (2 * held.first.focal)
    torch.testing.assert_close(sagittal[1:], -(sag * (1 + 1 / INDEX))[1:], rtol=0.01, atol=0)
    torch.testing.assert_close(tangential[1:], -(sag * (3 + 1 / INDEX))[1:], rtol=0.01, atol=0)


def test_the_focus_of_a_nearer_point_lies_farther_behind():
    """By Newton's formula f^2 / (distance - f), from the plane of points at infinity."""
    held = thin().held()
    found = foci(held, torch.zeros(1, dtype=torch.float64), held.wavelength, 50e3)
    expected = held.first.focal**2 / (50e3 - held.first.focal)
    for focus in found:
        assert float(focus[0]) == pytest.approx(expected, rel=2e-3)


def test_a_stop_before_a_thin_lens_gives_lateral_colour():
    """The chief ray is bent by its height at the lens over the focal length, which each colour has its own
    of."""
    lens = thin(stop_mm=100.0)
    held = lens.held()
    tangent, colours = 0.05, torch.tensor([450e-9, 650e-9], dtype=torch.float64)
    landed = heights(held, torch.tensor([tangent], dtype=torch.float64), colours, math.inf)[0]
    power = 1 / held.lens.index(colours)[:, 2].sub(1).reciprocal().mul(250.0)
    expected = -(power[1] - power[0]) * 100.0 * tangent * held.sensor
    assert float(landed[1] - landed[0]) == pytest.approx(float(expected), rel=0.02)
    none = heights(thin().held(), torch.tensor([tangent], dtype=torch.float64), colours, math.inf)[0]
    assert abs(float(none[1] - none[0])) < 0.01 * abs(float(expected))


@pytest.mark.parametrize("moved", [-4.0, 4.0])
def test_the_spot_of_a_thin_lens_out_of_focus_is_a_disc(moved):
    """Root mean square: its radius over the square root of two."""
    held = thin().held()
    spot = spots(held, 0.0, torch.tensor([held.wavelength], dtype=torch.float64), math.inf, moved)[0]
    radius = held.entrance_radius * abs(moved) / held.first.focal
    assert spot.rms == pytest.approx(radius / math.sqrt(2), rel=0.02)


@pytest.mark.parametrize("degrees", [0.0, 10.0, 20.0, 30.0])
def test_spots_lie_where_psfs_do(degrees):
    """Middle and widths along both axes of a lens that has every aberration; the pixel and diffraction make
    PSFs wider. Upside down, the middles would be apart by twice their height."""
    camera = Camera.from_recipe(load_camera("aspheres-5mm-f3").recipe)
    lens = camera.lens
    assert isinstance(lens, PrescriptionLens)
    tangent = math.tan(math.radians(degrees))
    moved = lens.held().scale ** 2 * (1 / lens.held().scale - 1e-3 / camera.sensor_distance)
    spot = spots(lens.held(), tangent, torch.tensor([GREEN]).double(), lens.held().distance, moved)[0]
    bank = psf_bank(camera.at_field((0.0, tangent)), [GREEN], [1e3 / lens.held().distance], window_px=96)
    psf = bank.values[0, 0].double() / bank.values.sum()
    at = (torch.arange(96, dtype=torch.float64) - 48) * camera.pixel * 1e3
    across, down = psf.sum(0), psf.sum(1)
    middle = -float((down * at).sum())
    assert float((across * at).sum()) == pytest.approx(0, abs=2e-4)
    assert middle == pytest.approx(float(spot.y.mean()), abs=1.5e-3)
    for light, places in ((across, spot.x), (down, spot.y)):
        width = float((light * at.square()).sum() - (light * at).sum().square())
        assert 0.95 * float(places.var()) < width < 1.2 * float(places.var()) + 3e-5


def test_tangential_and_sagittal_are_along_and_across_the_field():
    """Wherever it is: MTFs turn with the place."""
    camera = Camera.from_recipe(load_camera("aspheres-5mm-f3").recipe)
    found = []
    for right, up in ((0.0, 0.17), (0.17, 0.0), (0.1, -math.sqrt(0.17**2 - 0.01))):
        found.append(tangential_sagittal(camera.at_field((right, up)), GREEN, [1.0], [100e3])[:, 0, 0])
    assert float(found[0][1] - found[0][0]) > 0.2
    torch.testing.assert_close(found[1], found[0], rtol=0, atol=0.01)
    torch.testing.assert_close(found[2], found[0], rtol=0, atol=0.01)
    above = camera.at_field((0.0, 0.17))
    torch.testing.assert_close(mtf(above, GREEN, [1.0], [100e3], angle_deg=90)[0, 0], found[0][0])
