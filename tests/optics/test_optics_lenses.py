"""Kinds of lenses against closed forms, stationary paths (Fermat), third-order theory and a catalogue."""

from __future__ import annotations

import json
import logging
import math

import numpy as np
import pytest
import torch
from scipy.optimize import root
from scipy.special import j1, jv

from edofsim.capture.fidelity import Fidelity, simpler_camera
from edofsim.errors import InputError
from edofsim.optics import (
    Camera,
    best_focus_distance,
    defocus,
    focal_length,
    focus_distance,
    psf_bank,
)
from edofsim.optics.camera import cutoff_frequency
from edofsim.optics.lenses.achromat import AchromatLens, _path
from edofsim.optics.lenses.ideal import IdealLens
from edofsim.optics.lenses.plano_convex import PlanoConvexLens
from edofsim.optics.mtf import mtf, strehl
from edofsim.recipe.camera import CameraRecipe
from edofsim.recipe.load import load_camera

GREEN = 543e-9
D, F, C = 587.6e-9, 486.1e-9, 656.3e-9
FAST = {"kind": "ideal", "focal_length_mm": 50.0, "f_number": 2.0}
PHONE = {"kind": "ideal", "focal_length_mm": 5.0, "f_number": 2.0}


def camera(lens: dict, pixel_um: float = 3.45, **psf) -> Camera:
    recipe = CameraRecipe(name="lens", lens=lens, sensor={"pixel_um": pixel_um}, psf=psf)
    return Camera.from_recipe(recipe)


def doublet(f_number: float, focal_length_mm: float = 50.0) -> AchromatLens:
    return AchromatLens(kind="achromat", focal_length_mm=focal_length_mm, f_number=f_number)


@pytest.mark.parametrize("lens", [FAST, PHONE], ids=["50 mm", "5 mm"])
@pytest.mark.parametrize("wavelength", [450e-9, 650e-9])
def test_an_ideal_lens_gives_the_airy_disk(lens, wavelength):
    """(2 J1(v) / v)^2, v = 2 pi r x / (lambda z_i): Goodman, Introduction to Fourier Optics, 4.4.2; in focus
    at every wavelength."""
    seen = camera(lens, pixel_um=0.25, window_px=41, oversampling=4)
    bank = psf_bank(seen, [wavelength], [1 / 1.5], dtype=torch.float64)
    at = (torch.arange(41 * 4, dtype=torch.float64) + 0.5) * 0.25e-6 / 4 - 20.5 * 0.25e-6
    scale = 2 * math.pi * seen.aperture_radius / (wavelength * seen.sensor_distance)
    v = torch.hypot(at[:, None], at) * scale
    airy = (2 * torch.from_numpy(j1(v.numpy())) / v) ** 2
    peak = math.pi * (seen.aperture_radius / (wavelength * seen.sensor_distance)) ** 2
    expected = (airy * peak * (0.25e-6 / 4) ** 2).reshape(41, 4, 41, 4).sum((1, 3))
    assert float((bank.values[0, 0] - expected).abs().max()) < 2e-3 * float(expected.max())


@pytest.mark.parametrize("lens", [FAST, PHONE], ids=["50 mm", "5 mm"])
def test_an_ideal_lens_has_the_diffraction_mtf(lens):
    """2 / pi (acos s - s sqrt(1 - s^2)) of a clear circle: Goodman, 6.4.3."""
    seen = camera(lens)
    s = torch.linspace(0, 0.95, 12, dtype=torch.float64)
    found = mtf(seen, GREEN, [1 / 1.5], s * cutoff_frequency(seen, GREEN))[0]
    expected = 2 / math.pi * (torch.acos(s) - s * (1 - s**2).sqrt())
    torch.testing.assert_close(found, expected, atol=2e-3, rtol=0)


@pytest.mark.parametrize("lens", [FAST, PHONE], ids=["50 mm", "5 mm"])
def test_pixels_larger_than_the_disk_hold_its_light(lens):
    """Within a circle about the Airy disk 1 - J0(v)^2 - J1(v)^2 of its light (Born and Wolf, 8.5.2): a square
    window has at least that of the circle in it, and at most that of the circle around it."""
    seen = camera(lens, window_px=32)
    bank = psf_bank(seen, [550e-9], [1 / 1.5])
    scale = 2 * math.pi * seen.aperture_radius / (550e-9 * seen.sensor_distance)
    low, high = (
        1 - jv(0, v) ** 2 - jv(1, v) ** 2
        for v in (scale * 15 * seen.pixel, scale * 17 * seen.pixel * math.sqrt(2))
    )
    assert low < float(bank.values.sum()) < high
    assert float(bank.values.sum() + bank.truncated) == pytest.approx(1, abs=1e-5)


def test_an_ideal_lens_is_the_parabola_at_one_wavelength():
    parabola = PlanoConvexLens(surface_profile="parabolic")
    focal = float(parabola.focal_length(D))
    lens = IdealLens(kind="ideal", focal_length_mm=focal * 1e3, f_number=focal / 5e-3)
    ours, theirs = (
        psf_bank(Camera.from_recipe(CameraRecipe(name="x", lens=each)), [D], [0.0, 1.3], window_px=32).values
        for each in (lens, parabola)
    )
    torch.testing.assert_close(ours, theirs, atol=1e-7, rtol=1e-4)
    assert (focus_distance(camera(FAST), torch.tensor([F, D, C])) - 1.5).abs().max() < 1e-9


def test_the_doublet_is_the_catalogues():
    """Thorlabs, AC254-050-A: focal length 50.2 mm, the focus 43.4 mm behind its last surface."""
    focal, behind = doublet(4.0)._focus(D, scaled=False)
    assert focal == pytest.approx(50.2, rel=3e-3) and behind == pytest.approx(43.4, rel=3e-3)
    assert float(doublet(4.0, 80.0).focal_length(D)) == pytest.approx(80e-3, rel=1e-12)


def paraxial_focus(lens: AchromatLens, wavelength: float) -> float:
    """Distance of the focus from the last surface by the product of matrices of (height, angle) [m]."""
    radii, thicknesses = lens._scaled()
    n = lens._indices(wavelength)
    system = np.eye(2)
    for k, radius in enumerate(radii):
        surface = np.array([[1, 0], [(n[k] - n[k + 1]) / (radius * n[k + 1]), n[k] / n[k + 1]]])
        gap = np.array([[1, thicknesses[k] if k < 2 else 0], [0, 1]])
        system = gap @ surface @ system
    return -system[0, 0] / system[1, 0]


def test_the_doublet_brings_colours_together():
    """Its focus moves as that of rays near the axis; less than a quarter of what it moves in a singlet of
    N-BK7, the focal length over Abbe's number, 64.17."""
    lens = doublet(4.0)
    moved = lens.focal_length(torch.tensor([F, C], dtype=torch.float64)) - lens.focal_length(D)
    expected = [paraxial_focus(lens, w) - paraxial_focus(lens, D) for w in (F, C)]
    assert moved.tolist() == pytest.approx(expected, rel=1e-9)
    singlet = PlanoConvexLens(material="N-BK7", radius_of_curvature_mm=25.84, aperture_radius_mm=5)
    alone = singlet.focal_length(torch.tensor([F, C]))
    assert float(moved[1] - moved[0]) < 0.25 * float(alone[1] - alone[0])
    assert float(alone[1] - alone[0]) == pytest.approx(float(singlet.focal_length(D)) / 64.17, rel=0.01)


def stationary(lens: AchromatLens, wavelength: float, height: float) -> float:
    """Optical path from a plane wave to the sphere about the focus, [m], through the points of the surfaces
    where it is stationary (Fermat), for light that enters at `height`. No ray is traced."""
    radii, thicknesses = lens._scaled()
    n = lens._indices(wavelength)
    focal, behind = lens._focus(wavelength)
    vertices = (0.0, thicknesses[0], sum(thicknesses))
    centre = vertices[2] + behind

    def points(at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        y = np.array([height, at[0], at[1], -focal * math.sin(at[2])])
        z = [v + r - math.copysign(math.sqrt(r**2 - h**2), r)
             for v, r, h in zip(vertices, radii, y[:3], strict=True)]  # fmt: skip
        return np.append(y[:3], focal * math.sin(at[2])), np.array([*z, centre - focal * math.cos(at[2])])

    def slopes(at: np.ndarray) -> list[float]:
        """Of the path by the height on each surface, the entrance's included; the end lies on the sphere."""
        step = 1e-7
        found = []
        for surface in range(3):
            ends = []
            for sign in (1, -1):
                y, z = points(at)
                y[surface] += sign * step
                r = radii[surface]
                z[surface] = vertices[surface] + r - math.copysign(math.sqrt(r**2 - y[surface] ** 2), r)
                ends.append(length(y, z))
            found.append((ends[0] - ends[1]) / (2 * step) * 1e3)
        return found

    def length(y: np.ndarray, z: np.ndarray) -> float:
        last = math.copysign(1.0, z[3] - z[2])
        return float(n[0] * z[0] + (np.hypot(np.diff(y), np.diff(z)) * [n[1], n[2], last * n[3]]).sum())

    first = np.array([height * 0.97, height * 0.95, height / focal])
    solved = root(slopes, first, tol=1e-12)
    assert max(abs(slope) for slope in slopes(solved.x)) < 1e-4
    return length(*points(solved.x))


@pytest.mark.parametrize("wavelength", [450e-9, 650e-9])
@pytest.mark.parametrize("f_number", [2.0, 4.0])
def test_rays_of_the_doublet_take_paths_that_are_stationary(f_number, wavelength):
    lens = doublet(f_number)
    heights = np.array([0.3, 0.7, 1.0]) * lens.aperture_radius
    traced = _path(lens, wavelength, heights)
    assert traced == pytest.approx([stationary(lens, wavelength, h) for h in heights], abs=wavelength / 1000)
    axis = _path(lens, wavelength, np.zeros(1))
    wave = lens.phase(torch.from_numpy(heights).square(), wavelength).numpy() * wavelength / (2 * math.pi)
    assert wave == pytest.approx(traced - axis, abs=wavelength / 1000)


def test_small_apertures_have_the_aberration_of_third_order():
    """Seidel's sum S_I = -sum A^2 y (u'/n' - u/n), of which the wave lacks S_I / 8 at the rim (Welford,
    Aberrations of Optical Systems, 8.2)."""
    lens = doublet(16.0)
    radii, thicknesses = lens._scaled()
    n = lens._indices(D)
    y, u, total = lens.aperture_radius, 0.0, 0.0
    for k, radius in enumerate(radii):
        incidence = n[k] * (u + y / radius)
        after = (n[k] * u - y * (n[k + 1] - n[k]) / radius) / n[k + 1]
        total -= incidence**2 * y * (after / n[k + 1] - u / n[k])
        u = after
        y += u * thicknesses[k] if k < 2 else 0
    rim = torch.tensor([lens.aperture_radius**2], dtype=torch.float64)
    found = float(lens.phase(rim, D)) * D / (2 * math.pi)
    assert found == pytest.approx(-total / 8, rel=0.03)


@pytest.mark.parametrize("lens", [PlanoConvexLens(), doublet(4.0)], ids=["plano-convex", "achromat"])
def test_what_is_left_out_of_a_lens(lens):
    """Without dispersion it delays all light as much as that of one wavelength; without spherical aberration
    only the parabola is left."""
    q = torch.linspace(0, lens.aperture_radius**2, 9, dtype=torch.float64)
    plain = lens.without_dispersion(D)
    assert torch.equal(plain.focal_length(torch.tensor([F, C])), lens.focal_length(D).expand(2))
    torch.testing.assert_close(plain.phase(q, F) * F, lens.phase(q, D) * D)
    assert torch.equal(plain.phases(q)(F), plain.phase(q, F))
    bare = plain.without_spherical_aberration()
    assert not bare.phase(q, F).any() and not bare.slope(q.sqrt(), F).any()
    assert not bare.aberrates and not bare.disperses and bare.without_dispersion(F) is bare
    radii = q.sqrt()[:-1]
    step = 1e-9
    rise = (lens.phase((radii + step).square(), F) - lens.phase((radii - step).square(), F)) / (2 * step)
    torch.testing.assert_close(lens.slope(radii, F), rise, rtol=1e-3, atol=1.0)
    names = {each.identity() for each in (lens, plain, bare, lens.without_dispersion(F))}
    assert len(names) == 4 and all(json.loads(name) for name in names)


def test_a_fidelity_takes_the_simpler_lens():
    whole = camera({"kind": "achromat", "focal_length_mm": 20.0, "f_number": 4.0}, window_px=32)
    simpler = simpler_camera(whole, Fidelity(spherical_aberration=False, lens_dispersion=False))
    assert float(focal_length(simpler, F)) == float(focal_length(whole, D))
    ideal = camera({"kind": "ideal", "focal_length_mm": 20.0, "f_number": 4.0}, window_px=32)
    ours, theirs = (psf_bank(each, [F], [0.5]).values for each in (simpler, ideal))
    torch.testing.assert_close(ours, theirs, atol=1e-7, rtol=1e-4)


def test_a_lens_that_aberrates_too_much_is_told_what_helps():
    wide = {"radius_of_curvature_mm": 22.92, "aperture_radius_mm": 12.5}
    words = 'spherical aberration of the lens .*smaller aperture.*"achromat".*"ideal"'
    with pytest.raises(InputError, match=words):
        psf_bank(camera(wide), [GREEN], [1 / 1.5])
    with pytest.raises(InputError, match="leave out the extreme depths"):
        psf_bank(camera(FAST | {"f_number": 0.5}), [GREEN], [8.0])


@pytest.mark.parametrize(
    ("lens", "words"),
    [
        ({"kind": "achromat", "focal_length_mm": 50, "f_number": 1.2}, "f_number = 1.2: .* cross"),
        ({"kind": "achromat", "focal_length_mm": 50, "f_number": 0.5}, "wider than a surface"),
        (
            {"kind": "achromat", "focal_length_mm": 50, "f_number": 4, "radii_mm": (-33.3, 22.28, 291.07)},
            "does not focus",
        ),
        ({"kind": "achromat", "focal_length_mm": 50, "f_number": 4, "radii_mm": (0, 1, 1)}, "radius of 0"),
        (
            {"kind": "achromat", "focal_length_mm": 50, "f_number": 4, "materials": ("N-BAF10", "N-SF100")},
            r"lens.materials\[1\]: .*did you mean 'N-SF10'",
        ),
        ({"kind": "ideal", "focal_length_mm": 1600, "f_number": 4}, "inside the focal length"),
    ],
)
def test_lenses_that_cannot_be_say_why(lens, words):
    with pytest.raises(InputError, match=words):
        camera(lens)


OLD = """\
name = "old"
[lens]
radius_of_curvature_mm = 20.0
thickness = "parabolic"
"""


def test_a_recipe_of_before_is_read_and_told_the_new_name(tmp_path, caplog):
    path = tmp_path / "old.toml"
    path.write_text(OLD)
    with caplog.at_level(logging.WARNING):
        lens = load_camera(path).recipe.lens
    assert lens == PlanoConvexLens(radius_of_curvature_mm=20.0, surface_profile="parabolic")
    (line,) = caplog.messages
    assert "old.toml: thickness = 'parabolic' is now surface_profile = 'parabolic'" in line
    old = CameraRecipe.model_validate({"name": "card", "lens": {"thickness": "exact"}})
    assert old.lens == PlanoConvexLens() and len(caplog.messages) == 1
    path.write_text(OLD.replace("thickness", "thicknes"))
    with pytest.raises(InputError, match="line 4: unknown key 'lens.thicknes'"):
        load_camera(path)
    path.write_text(OLD.replace("[lens]", '[lens]\nkind = "idael"'))
    with pytest.raises(InputError, match="unknown kind 'idael'; did you mean 'ideal'"):
        load_camera(path)


def test_best_focus_is_where_the_strehl_ratio_is_largest():
    # of W rho^4 the wave departs least from a sphere at Psi = -W, by W / sqrt(180) (Born and Wolf, section
    # 9.3)
    lens = {"radius_of_curvature_mm": 16.51, "aperture_radius_mm": 1.5}
    camera = Camera.from_recipe(CameraRecipe.model_validate({"name": "small", "lens": lens}))
    best, paraxial = best_focus_distance(camera, GREEN), float(focus_distance(camera, GREEN))
    rim = float(camera.lens.phase(torch.tensor(camera.aperture_radius**2, dtype=torch.float64), GREEN))
    assert 0.5 < abs(rim) < 2 and 1.05 * best < paraxial
    assert float(defocus(camera, GREEN, 1 / best)) == pytest.approx(-rim, rel=0.02)
    around = 1 / best + torch.linspace(-0.3, 0.3, 13, dtype=torch.float64)
    ratios = strehl(camera, [GREEN], around, on_axis=True)[:, 0]
    assert int(ratios.argmax()) == 6
    assert float(ratios[6]) == pytest.approx(math.exp(-(rim**2) / 180), abs=2e-3)


def test_a_camera_is_focused_at_the_best_plane_on_request():
    focus = {"distance_m": 2.0, "plane": "best"}
    camera = Camera.from_recipe(CameraRecipe.model_validate({"name": "best", "focus": focus}))
    assert best_focus_distance(camera, 587.6e-9) == pytest.approx(2.0)
    assert float(focus_distance(camera, 587.6e-9)) > 2.5
    lens = {"kind": "ideal", "focal_length_mm": 50, "f_number": 2}
    ideal = Camera.from_recipe(CameraRecipe.model_validate({"name": "ideal", "lens": lens, "focus": focus}))
    assert float(focus_distance(ideal, 587.6e-9)) == pytest.approx(2.0)
