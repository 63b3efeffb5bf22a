"""Cameras as they are made: waves of draws against rays by vectors, closed forms of a thin lens and of a
mask, focusing, and seeds."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from edofsim.errors import InputError
from edofsim.optics import Camera, psf_bank
from edofsim.optics.grid import PupilGrid
from edofsim.optics.height import surface
from edofsim.optics.lenses.prescription import PrescriptionLens
from edofsim.optics.mtf import mtf
from edofsim.optics.prescription.errors import FOCUS, RADIUS, Errors
from edofsim.optics.prescription.outline import delay
from edofsim.optics.tolerancing import MASK, POWER, Draw, Series, parts_of
from edofsim.recipe import CameraRecipe, load_camera
from edofsim.recipe.tolerances import Tolerances
from tests.optics.test_prescription_errors import by_centres

LINE, MM = 587.6e-9, 1e-3
NONE = {
    "decentre_um": 0,
    "tilt_arcmin": 0,
    "spacing_um": 0,
    "index": 0,
    "radius_percent": 0,
    "power_percent": 0,
    "mask_height_percent": 0,
    "focus_um": 0,
}


def camera_of(name: str, **tolerances) -> Camera:
    loaded = load_camera(name)
    recipe = loaded.recipe.model_copy(update={"tolerances": Tolerances(**{**NONE, **tolerances})})
    return Camera.from_recipe(recipe, loaded.base)


def ideal(**more) -> Camera:
    recipe = {"name": "ideal", "lens": {"kind": "ideal", "focal_length_mm": 25, "f_number": 5}, **more}
    return Camera.from_recipe(CameraRecipe.model_validate(recipe))


def still(right, up, path):
    """Less its mean, and less what moves the image."""
    terms = np.stack([np.ones_like(right), right, up], -1)
    return path - terms @ np.linalg.lstsq(terms, path, rcond=None)[0]


def places_of(lens: PrescriptionLens, field, made) -> tuple[np.ndarray, ...]:
    """Rays of a grid from a place in the field, by vectors in the frame of the scene: where they meet the
    reference sphere beside the chief ray, over its radius, times the scale [mm], and their path [mm]."""
    held = lens.held()
    tangent = math.hypot(*field)
    seen, _ = lens.traced(tangent, LINE)
    index = held.lens.index(torch.tensor([LINE], dtype=torch.float64))[0].tolist()
    plane = float(seen.plane)
    away = held.distance + plane - held.first.entrance
    source = np.array([field[0] * away, field[1] * away, plane - away])
    shifts, turns = made

    def ray(x, y, shifts=shifts, turns=turns):
        toward = np.array([x, y, plane]) - source
        long = np.linalg.norm(toward)
        end, out, path = by_centres(held.lens, index, (x, y, plane), toward / long, shifts, turns)
        way = held.sensor / out[2]
        return end[:2] + way * out[:2], out, path + way + long - away

    centre, _, _ = ray(0.0, 0.0, {}, {})
    radius = math.sqrt(held.sphere**2 + centre @ centre)

    def on_sphere(x, y, *how):
        at, out, path = ray(x, y, *how)
        apart = np.array([*(at - centre), 0.0])
        along = apart @ out
        back = along + math.sqrt(along**2 - apart @ apart + radius**2)
        return (apart - back * out)[:2] / radius * held.scale, path - back

    chief, _ = on_sphere(0.0, 0.0, {}, {})
    half = 0.9 * held.entrance_radius
    grid = [(x * half, y * half) for x in np.linspace(-1, 1, 7) for y in np.linspace(-1, 1, 7)]
    found = [on_sphere(x, y) for x, y in grid if math.hypot(x, y) < half]
    place = np.array([p - chief for p, _ in found])
    return place[:, 0], place[:, 1], np.array([path for _, path in found])


@pytest.mark.parametrize("exactly", [True, False])
def test_waves_of_a_draw_are_those_of_vectors_in_any_direction(exactly):
    """The double Gauss seen from the upper left, an element decentred and another tilted: the phase that is
    added at places of the pupil, less what moves the image."""
    camera = camera_of("double-gauss-50mm-f4", decentre_um=10, refocused=False)
    lens = camera.lens
    assert isinstance(lens, PrescriptionLens)
    field = (-0.05, 0.03)
    errors = Errors({1: (0.06, -0.02)}, {2: (3e-4, 1e-3)})
    shifts, turns = {1: (0.06, -0.02, 0.0)}, {2: (3e-4, 1e-3, 0.0)}
    series = Series(camera, [0.0, math.hypot(*field)])
    made = series.made(Draw(errors), exactly=exactly).lens
    right, up, path = places_of(lens, field, (shifts, turns))
    x, y = torch.from_numpy(right), torch.from_numpy(up)
    designed = delay(lens.traced(math.hypot(*field), LINE)[1], x, y, math.atan2(field[1], field[0]))
    wanted = still(right, up, path - designed.numpy())
    added = made.field_phase(x * MM, y * MM, LINE, field) - lens.field_phase(x * MM, y * MM, LINE, field)
    told = still(right, up, (added * LINE / (2 * math.pi) / MM).numpy())
    assert np.abs(wanted).max() / (LINE / MM) > 0.07
    assert np.abs(told - wanted).max() < (0.002 if exactly else 0.04) * np.abs(wanted).max()


def test_a_longer_focal_length_leaves_a_parabola_that_focusing_takes_away():
    camera = ideal(tolerances={**NONE, "power_percent": 0.5})
    fixed = ideal(tolerances={**NONE, "power_percent": 0.5, "refocused": False})
    here = torch.tensor([0.0, 1e-3, 2.5e-3], dtype=torch.float64)
    for each, left in ((fixed, 1.0), (camera, 0.0)):
        series = Series(each, [0.0])
        draw = series.draw(3, 0)
        added = series.made(draw).lens.field_phase(here, 0 * here, LINE, (0.0, 0.0))
        wanted = 2 * math.pi / LINE * here.square() / 2 * draw.power / 0.025
        torch.testing.assert_close(added, left * wanted, rtol=1e-6, atol=1e-9)
        assert abs(draw.power) > 1e-4
        # r^4 / 48 is the mean square of r^2 / 2 over the disc
        waves = 0.005 / 0.025 * 2.5e-3**2 / math.sqrt(48) / LINE
        assert series.rms(series.parts[0]) == pytest.approx(left * waves, rel=1e-6, abs=1e-9)


def test_a_sensor_out_of_its_place_is_a_camera_that_is_focused_elsewhere():
    camera = ideal(tolerances={**NONE, "focus_um": 20}, focus={"distance_m": 2.0})
    back = 30e-6
    made = Series(camera, [0.0]).made(Draw(Errors(focus=back / MM)))
    distance = camera.sensor_distance + back
    nearer = 1 / (1 / 0.025 - 1 / distance)
    other = ideal(focus={"distance_m": nearer})
    frequencies = [20e3, 60e3]
    found, wanted, before = (mtf(each, LINE, [0.42], frequencies) for each in (made, other, camera))
    torch.testing.assert_close(found, wanted, atol=2e-3, rtol=0)
    assert float((wanted - before).abs().max()) > 0.05
    assert psf_bank(made, [LINE], [0.5], window_px=32).values.shape == (1, 1, 32, 32)


def test_focusing_leaves_the_least_of_the_change():
    """No place of the sensor brings the wave nearer the designed one, and leaving it costs a lot."""
    camera = camera_of("double-gauss-50mm-f4", radius_percent=0.1, spacing_um=20)
    series = Series(camera, [0.0])
    draw = series.draw(0, 1)
    assert abs(draw.errors.focus) > 0.02

    def left(focus: float) -> float:
        errors = replace(draw.errors, focus=focus)
        return series.difference(Draw(errors), (0.0, 0.0))[0]

    best = draw.errors.focus
    least = left(best)
    assert least < left(best + 0.03) and least < left(best - 0.03)
    assert left(0.0) > 10 * least
    alone = Series(
        camera_of("double-gauss-50mm-f4", radius_percent=0.1, spacing_um=20, refocused=False), [0.0]
    )
    assert alone.draw(0, 1).errors == replace(draw.errors, focus=0.0)
    for one, other in zip(series.parts, alone.parts, strict=True):
        assert series.rms(one) <= alone.rms(other)


def test_a_mask_is_as_much_higher_as_the_draw_says():
    """alpha (x^3 + y^3), less what moves the image, has the mean square alpha^2 / 32."""
    mask = {"kind": "cubic", "alpha_rad": 30.0}
    camera = ideal(mask=mask, tolerances={**NONE, "mask_height_percent": 3.0})
    series = Series(camera, [0.0])
    assert [part.kind for part in series.parts] == [MASK]
    made = series.made(Draw(Errors(), mask=0.03))
    grid = PupilGrid(130, 2 * camera.aperture_radius / 128, camera.aperture_radius)
    designed, higher = surface(camera, grid), surface(made, grid)
    assert designed is not None and higher is not None
    lit = grid.radius_squared().sqrt() < 0.95 * grid.radius
    assert float((higher - 1.03 * designed)[lit].abs().max()) < 2e-3 * float(designed[lit].abs().max())
    assert float((higher - designed)[lit].abs().max()) > 0.02 * float(designed[lit].abs().max())
    design = camera.mask.design_wavelength_nm * 1e-9
    ratio = float(camera.mask_material.index(LINE) - 1) / float(camera.mask_material.index(design) - 1)
    wanted = 0.03 * 30.0 / (2 * math.pi) * design / LINE * ratio / math.sqrt(32)
    assert series.rms(series.parts[0]) == pytest.approx(wanted, rel=0.01)


def test_draws_follow_from_seed_and_number_alone():
    camera = camera_of("doublet-25mm-f6", decentre_um=20, tilt_arcmin=2, refocused=False)
    series = Series(camera, [0.0])
    assert series.draw(1, 5) == Series(camera, [0.0]).draw(1, 5)
    assert len({series.draw(seed, number).said for seed in (0, 1) for number in range(5)}) == 10
    centres = torch.tensor([series.draw(0, number).errors.decentre[0] for number in range(400)])
    tilts = torch.tensor([series.draw(0, number).errors.tilt[0] for number in range(400)])
    for found, wanted in ((centres, 0.02), (tilts, math.radians(2 / 60))):
        assert found.std(0).tolist() == pytest.approx([wanted, wanted], rel=0.1)
        assert float(torch.corrcoef(found.T)[0, 1].abs()) < 0.15


def test_tolerances_of_one_element_replace_those_of_all():
    camera = camera_of("double-gauss-50mm-f4", decentre_um=20, radius_percent=0.1)
    own = {"surface": 7, "decentre_um": 5, "radius_percent": 0}
    parts = parts_of(
        camera, Tolerances(**{**NONE, "decentre_um": 20, "radius_percent": 0.1}, elements=(own,))
    )
    found = {part.name: part.deviation for part in parts}
    assert found["decentre.6-8"] == 5e-3 and found["decentre.0-1"] == 20e-3
    assert {name for name in found if name.startswith("radius")} == {
        f"radius.{k}" for k in (0, 1, 2, 3, 4, 9, 10)
    }


@pytest.mark.parametrize(
    "camera, tolerances, said",
    [
        ("double-gauss-50mm-f4", {"elements": [{"surface": 5}]}, "surface 5 is part of no element"),
        ("paper-cubic", {"elements": [{"surface": 0}]}, "has no surfaces"),
    ],
)
def test_what_there_is_not_is_refused(camera, tolerances, said):
    with pytest.raises(InputError, match=said):
        parts_of(camera_of(camera), Tolerances(**tolerances))


def test_kinds_of_what_can_be_wrong():
    kinds = {part.kind for part in parts_of(camera_of("paper-cubic"), Tolerances())}
    assert kinds == {POWER, FOCUS, MASK}
    parts = parts_of(camera_of("doublet-25mm-f6"), Tolerances())
    assert {part.name for part in parts if part.kind == RADIUS} == {"radius.1", "radius.2", "radius.3"}
