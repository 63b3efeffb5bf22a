"""The ray tracer against optiland and OpticStudio, against lenses that image perfectly, and against its own
slopes.

`optiland_rays.json` is what `optiland_rays.py` wrote.
"""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from edofsim.optics.materials import Material
from edofsim.optics.prescription.aim import chief_planes, focused, launch, on_sphere
from edofsim.optics.prescription.first_order import first_order
from edofsim.optics.prescription.outline import delay, opening
from edofsim.optics.prescription.pupil import pupil
from edofsim.optics.prescription.surfaces import Stack, Surface, by_abbe, stack
from edofsim.optics.prescription.trace import sag_and_slope, trace, why_lost
from edofsim.optics.prescription.waves import waves

LENSES = json.loads(Path(__file__).with_name("optiland_rays.json").read_text())
WITH_WAVES = [name for name, lens in LENSES.items() if "waves" in lens]


def numbers(values) -> torch.Tensor:
    return torch.tensor(values, dtype=torch.float64)


def surfaces(lens: dict) -> Stack:
    """A lens of the file, of glasses that have its middle wavelength's index at any."""
    none = torch.zeros(len(lens["radii"]), 0, dtype=torch.float64)
    media = (
        None if n == 1 else Material("", "", 1e-9, 1.0, cauchy=(n, 0, 0)) for n in lens["indices"][1][1:]
    )
    curvature = numbers([0.0 if radius is None else 1 / radius for radius in lens["radii"]])
    thickness = numbers(lens["thicknesses"])
    clear = (None,) * len(none)
    conics = numbers(lens["conics"])
    return Stack(curvature, conics, none, none, thickness, clear, lens["stop"], math.nan, tuple(media))


@pytest.mark.parametrize("name", LENSES)
def test_rays_are_those_of_optiland(name):
    """Three wavelengths, three fields, from infinity and 1 m: places to 1e-9 mm, paths to lambda/50 and far
    better."""
    lens = LENSES[name]
    held = surfaces(lens)
    for each in lens["rays"]:
        start, end = numbers(each["start"])[:, None], numbers(each["end"])[:, None]
        index = numbers(lens["indices"][each["wave"]])[None, None]
        found = trace(held, index, tuple(start[:3]), tuple(start[3:])).to_plane(lens["thicknesses"][-1])
        torch.testing.assert_close(torch.stack([found.x, found.y]), end[:2], atol=1e-9, rtol=0)
        directions = torch.stack([found.right, found.up, found.along])
        torch.testing.assert_close(directions, end[2:5], atol=1e-10, rtol=0)
        waves_apart = (found.path - end[5]) / (lens["wavelengths_um"][each["wave"]] * 1e-3)
        assert float(waves_apart.abs().max()) < 2e-6


@pytest.mark.parametrize("name", LENSES)
def test_pupils_and_focal_length_are_those_of_optiland(name):
    lens = LENSES[name]
    first = first_order(surfaces(lens), numbers(lens["indices"][1]))
    found = first.focal, first.entrance, first.exit - lens["thicknesses"][-1]
    assert found == pytest.approx((lens["focal"], lens["entrance"], lens["exit"]), rel=1e-11, abs=1e-11)


def test_a_singlet_has_the_first_order_of_opticstudio():
    """Ansys Zemax OpticStudio 2025 R2.02, by users in optiland's issue 710: glass LAC9, stop at the second
    surface."""
    lens = LENSES["singlet"]
    held = surfaces(lens)
    first = first_order(held, numbers(lens["indices"][1]))
    image = lens["thicknesses"][-1]
    assert first.focal == pytest.approx(101.501826, abs=1e-6)
    assert first.entrance == pytest.approx(6.318809, abs=1e-6)
    assert first.exit - image == pytest.approx(-92.738350, abs=1e-5)
    assert first.focus - image == pytest.approx(2.255622, abs=1e-6)
    assert first.focal / 25 == pytest.approx(4.060073, abs=1e-6)
    assert 25 / first.opening == pytest.approx(23.397110, abs=2e-5)  # stop and exit pupil are one here


@pytest.mark.parametrize("name", WITH_WAVES)
def test_waves_are_those_of_optiland(name):
    """Real stop, real chief rays, reference sphere, and polynomials: lambda/1000 at the worst ray, from
    infinity and from 30 focal lengths, on the axis, at 0.7 and at the whole field."""
    lens = LENSES[name]
    wavelength = lens["wavelengths_um"][1] * 1e-6
    for each in lens["waves"]:
        distance = math.inf if each["distance"] is None else each["distance"]
        held = focused(surfaces(lens), wavelength, distance, lens["diameter"] / 2)
        tangent = numbers([each["tangent"]])
        wave = waves(pupil(held, tangent), numbers([wavelength]))[0]
        assert wave.landing == pytest.approx(abs(each["landing"]), abs=1e-7)
        s = numbers(each["x"]) / each["radius"] * held.scale
        t = (numbers(each["y"]) - each["landing"]) / each["radius"] * held.scale
        t = -t if each["tangent"] > 0 else t  # optiland's angles are those of rays, not of the scene
        t = t - chief_place(held, tangent) * held.scale
        path = -numbers(each["opd"]) * wavelength * 1e3
        apart = (delay(wave, s, t, math.pi / 2) - path) / (wavelength * 1e3)
        assert float(apart.abs().max()) < 1e-3
        assert float(path.abs().max()) / (wavelength * 1e3) > 0.01
        assert bool((opening(wave, s * 0.99, t * 0.99, math.pi / 2) == 1).all())


def chief_place(held, tangent) -> float:
    """Where the chief ray meets the reference sphere, over its radius."""
    plane, zero = chief_planes(held, tangent)[:, None], torch.zeros(1, 1, dtype=torch.float64)
    vergence = 1 / (held.distance + plane - held.first.entrance)
    start, direction, _ = launch(plane, tangent[:, None], vergence, zero, zero)
    index = held.lens.index(numbers([held.wavelength]))[:, None]
    rays = trace(held.lens, index, start, direction).to_plane(held.sensor)
    return float(on_sphere(held, rays, rays.y[:, 0])[1])


def perfect(index: float, radius: float = 20.0, thickness: float = 6.0) -> list[Surface]:
    """A lens without aberrations on its axis: an ellipsoid, k = -1 / n^2, and a sphere about its focus
    (Descartes)."""
    back = radius * index / (index - 1) - thickness
    glass = {"sellmeier": [(index**2 - 1, 0.0)], "wavelengths_nm": (300, 900)}
    return [
        Surface(radius_mm=radius, conic=-1 / index**2, thickness_mm=thickness, stop=True, **glass),
        Surface(radius_mm=back),
    ]


def parallel(heights) -> tuple:
    heights = numbers(heights)[None]
    zero = torch.zeros_like(heights)
    return (zero, heights, zero), (zero, zero, zero + 1)


def test_an_ellipsoid_images_infinity_into_a_point():
    held = stack(perfect(1.6))
    index = held.index(numbers([550e-9]))
    rays = trace(held, index[:, None], *parallel([0.0, 3.0, 8.0, 12.0]))
    rays = rays.to_plane(first_order(held, index[0]).focus)
    assert float(rays.y.abs().max()) < 1e-12
    assert float((rays.path - rays.path[0, 0]).abs().max()) < 1e-12


def test_an_asphere_of_the_shape_of_a_conic_bends_as_it_does():
    """A paraboloid is r^2 / 2R: by the closed form, and by Newton's method from the plane."""
    glass = {"nd": 1.5, "vd": 60.0, "thickness_mm": 5.0, "stop": True}
    conic = stack([Surface(radius_mm=30.0, conic=-1.0, **glass), Surface()])
    asphere = stack([Surface(aspheres_mm=(1 / 60,), **glass), Surface()])
    index = conic.index(numbers([550e-9]))
    one, other = (trace(each, index[:, None], *parallel([0.5, 4.0, 9.0])) for each in (conic, asphere))
    assert first_order(asphere, index[0]).focal == pytest.approx(
        first_order(conic, index[0]).focal, rel=1e-14
    )
    torch.testing.assert_close(one.y, other.y, atol=1e-12, rtol=0)
    torch.testing.assert_close(one.path, other.path, atol=1e-12, rtol=0)


def test_rays_meet_an_asphere_of_odd_powers():
    held = stack(
        [
            Surface(
                radius_mm=2.0,
                conic=1.1,
                aspheres_mm=(0.01, 0.02, -0.05),
                odd_aspheres_mm=(-0.02, -0.04),
                stop=True,
            )
        ]
    )
    start, _ = parallel([0.0, 0.2, 0.5, 0.7])
    tilt = 0.3 + torch.zeros_like(start[0])
    direction = 0 * tilt, tilt, torch.sqrt(1 - tilt.square())
    rays = trace(held, torch.ones(1, 1, 2, dtype=torch.float64), start, direction, keep=(0,))
    radius = rays.at[0][1].abs()
    sag = radius**2 / 2 / (1 + torch.sqrt(1 - 2.1 * radius**2 / 4)) + 0.01 * radius**2 + 0.02 * radius**4
    sag = sag - 0.05 * radius**6 - 0.02 * radius**3 - 0.04 * radius**5
    torch.testing.assert_close(
        (rays.at[0][1] - start[1]) * direction[2] / direction[1], sag, atol=1e-13, rtol=0
    )
    shape = 0.5, 1.1, [0.01, 0.02, -0.05], [-0.02, -0.04]
    step = 1e-6
    more, less = (sag_and_slope(shape, (radius + each).square())[0] for each in (step, -step))
    slope = sag_and_slope(shape, radius.square())[1] * radius
    torch.testing.assert_close(slope[radius > 0], ((more - less) / (2 * step))[radius > 0], atol=1e-8, rtol=0)


@pytest.mark.parametrize("what", ["curvature", "thickness", "even", "conic"])
def test_gradients_are_differences(what):
    glass = {"nd": 1.6, "vd": 50.0, "thickness_mm": 4.0}
    held = stack(
        [
            Surface(radius_mm=25.0, conic=0.3, aspheres_mm=(0.0, 1e-5), stop=True, **glass),
            Surface(radius_mm=-40.0, conic=-0.5, aspheres_mm=(1e-4, 0.0)),
        ]
    )
    index = held.index(numbers([550e-9]))[:, None]

    def total(values: torch.Tensor) -> torch.Tensor:
        """Of rays, one of which misses."""
        rays = trace(replace(held, **{what: values}), index, *parallel([2.0, 6.0, 26.0])).to_plane(30.0)
        fine = rays.lost == 0
        assert int(fine.sum()) == 2
        return (rays.path + rays.y)[fine].sum()

    at = getattr(held, what).clone().requires_grad_()
    total(at).backward()
    assert bool(torch.isfinite(at.grad).all())
    for place in torch.nonzero(torch.ones_like(at)):
        step = torch.zeros_like(at)
        step[tuple(place)] = 1e-7
        by_steps = float((total(at.detach() + step) - total(at.detach() - step)) / 2e-7)
        assert float(at.grad[tuple(place)]) == pytest.approx(by_steps, rel=1e-5, abs=1e-5)


def test_lost_rays_say_why():
    front = Surface(radius_mm=10.0, nd=1.5, vd=60.0, thickness_mm=4.0, stop=True)
    for back, height, reason in (
        (Surface(), 11.0, "miss surface 0"),
        (Surface(radius_mm=-3.0), 6.5, "miss surface 1"),
        (Surface(radius_mm=-5.0), 4.6, "totally reflected at surface 1"),
        (Surface(radius_mm=40.0, conic=-1.0), 9.2, "leave the glass before surface 1"),
    ):
        held = stack([front, back])
        index = held.index(numbers([550e-9]))[:, None]
        rays = trace(held, index, *parallel([0.1, height]))
        assert rays.lost[0, 0] == 0 and math.isfinite(float(rays.y[0, 0]))
        assert bool(torch.isnan(rays.y[0, 1]))
        assert reason in why_lost(held, rays.lost)


@pytest.mark.parametrize("nd, vd", [(1.5168, 64.17), (1.744, 44.7), (1.603, 27.5)])
def test_glass_by_its_abbe_number_has_it(nd, vd):
    glass = by_abbe(nd, vd)
    d, f, c, g = (float(glass.index(nm * 1e-9)) for nm in (587.56, 486.13, 656.27, 435.83))
    assert d == pytest.approx(nd, abs=1e-12)
    assert (d - 1) / (f - c) == pytest.approx(vd, rel=1e-9)
    assert (g - f) / (f - c) == pytest.approx(0.6438 - 0.001682 * vd, rel=1e-9)


def test_glass_by_its_abbe_number_is_near_the_catalogue():
    """N-BK7, SCHOTT: 1.52668 at g, 1.51432 at C."""
    glass = by_abbe(1.51680, 64.17)
    assert float(glass.index(435.83e-9)) == pytest.approx(1.52668, abs=1e-4)
    assert float(glass.index(656.27e-9)) == pytest.approx(1.51432, abs=1e-4)
