"""Lenses that are not made as designed: moved surfaces against a vector ray trace of spheres by their
centres, first order against closed forms and against exact rays."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from edofsim.optics import Camera
from edofsim.optics.lenses import prescription
from edofsim.optics.lenses.prescription import PrescriptionLens
from edofsim.optics.prescription.errors import (
    FOCUS,
    SPACING,
    TILT,
    Errors,
    elements_of,
    exact,
    first_order,
    slopes,
    with_errors,
)
from edofsim.optics.prescription.first_order import first_order as paraxial
from edofsim.optics.prescription.polynomials import basis
from edofsim.optics.prescription.surfaces import Surface
from edofsim.optics.prescription.trace import trace
from edofsim.recipe import load_camera

CAMERAS = ("doublet-25mm-f6", "double-gauss-50mm-f4", "aspheres-5mm-f3")
LINE = 587.6e-9
MM = 1e-3


def lens_of(name: str) -> PrescriptionLens:
    loaded = load_camera(name)
    lens = Camera.from_recipe(loaded.recipe, loaded.base).lens
    assert isinstance(lens, PrescriptionLens)
    return lens


def seen_of(lens: PrescriptionLens, tangent: float):
    return prescription._pupil(lens, tangent, 0.0), prescription._wave(lens, tangent, LINE)


def perfect(plate: bool = False) -> PrescriptionLens:
    """A plane and a hyperboloid of conic -n^2 bring parallel light to a point without any aberration; a plate
    behind it."""
    n = 1.5
    rows = [
        Surface(stop=True, thickness_mm=4.0, nd=n, vd=1e6),
        Surface(radius_mm=-10.0, conic=-n * n, thickness_mm=5.0),
    ]
    rows += [Surface(thickness_mm=3.0, nd=1.6, vd=1e6), Surface()] if plate else []
    return PrescriptionLens(kind="prescription", surfaces=tuple(rows), f_number=4.0)


def by_centres(lens, index, place, direction, shifts, turns):
    """OPL and end of one ray: each sphere is moved by moving its centre about its element's middle, planes by
    their point and normal. Written without the package's tracer."""

    def rotation(turn):
        angle = np.linalg.norm(turn)
        if angle == 0:
            return np.eye(3)
        x, y, z = np.asarray(turn) / angle
        cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        return (
            np.eye(3) * math.cos(angle)
            + math.sin(angle) * cross
            + (1 - math.cos(angle)) * np.outer([x, y, z], [x, y, z])
        )

    vertices = np.concatenate([[0], np.cumsum(lens.thickness.numpy())])[: len(lens)]
    place, direction, path = np.array(place, float), np.array(direction, float), 0.0
    owner = {s: e for e, some in enumerate(elements_of(lens)) for s in some}
    for k in range(len(lens)):
        element = owner.get(k)
        middle = np.zeros(3)
        if element is not None:
            some = elements_of(lens)[element]
            middle[2] = (vertices[some[0]] + vertices[some[-1]]) / 2
        turn, shift = rotation(turns.get(element, (0, 0, 0))), np.array(shifts.get(element, (0, 0, 0)), float)
        vertex = turn @ (np.array([0, 0, vertices[k]]) - middle) + middle + shift
        c = float(lens.curvature[k])
        if c:
            centre = turn @ (np.array([0, 0, vertices[k] + 1 / c]) - middle) + middle + shift
            apart = place - centre
            half = apart @ direction
            root = math.sqrt(half**2 - apart @ apart + 1 / c**2)
            way = min(
                (-half - root, -half + root), key=lambda w: np.linalg.norm(place + w * direction - vertex)
            )
            normal = (centre - (place + way * direction)) * c
        else:
            normal = turn @ np.array([0, 0, 1.0])
            way = normal @ (vertex - place) / (normal @ direction)
        place, path = place + way * direction, path + index[k] * way
        ratio, cosine = index[k] / index[k + 1], normal @ direction
        direction = ratio * direction + (math.sqrt(1 - ratio**2 * (1 - cosine**2)) - ratio * cosine) * normal
    way = (vertices[-1] - place[2]) / direction[2]
    return place + way * direction, direction, path + index[-1] * way


@pytest.mark.parametrize("name", CAMERAS[:2])
def test_moved_spheres_are_met_where_vectors_say(name):
    lens = lens_of(name).held().lens
    index = lens.index(torch.tensor([LINE], dtype=torch.float64))
    count = len(elements_of(lens))
    shifts = {e: (0.05 * (e + 1), -0.03 * (e + 2), 0.0) for e in range(count)}
    turns = {e: (0.004 * (e + 1), -0.002 * (e + 1), 0.0) for e in range(count)}
    made = with_errors(
        lens, Errors({e: s[:2] for e, s in shifts.items()}, {e: t[:2] for e, t in turns.items()})
    )
    direction = np.array([0.03, -0.05, 0.0])
    direction[2] = math.sqrt(1 - direction @ direction)
    for place in ((0.3, 1.0, -5.0), (-0.8, 0.4, -5.0)):
        end, out, path = by_centres(lens, index[0].tolist(), place, direction, shifts, turns)
        one = tuple(torch.tensor([[v]], dtype=torch.float64) for v in place)
        ways = tuple(torch.tensor([[v]], dtype=torch.float64) for v in direction)
        found = trace(made, index[:, None], one, ways)
        assert (found.x.item(), found.y.item()) == pytest.approx(end[:2], abs=1e-11)
        assert (found.right.item(), found.up.item()) == pytest.approx(out[:2], abs=1e-12)
        assert found.path.item() == pytest.approx(path, abs=1e-11)


@pytest.mark.parametrize("name", CAMERAS)
def test_first_order_is_the_slope_of_exact_paths(name):
    """Every error of every element and surface by itself, ray by ray: differences of exact paths to 1 % of
    the largest change."""
    lens = lens_of(name)
    seen, wave = seen_of(lens, 0.06)
    found = slopes(seen, LINE)
    lit = found.rays.inside[0]
    step = {"decentre": 2e-4, "tilt": 1e-4, "spacing": 1e-3, "index": 1e-5, "radius": 1e-4}
    assert {kind for kind, _ in found.names} == {*step, FOCUS}
    for kind, number in found.names[:: 3 if name == "aspheres-5mm-f3" else 1]:  # by Newton: seconds
        for vector in ((1.0, 0.0), (0.0, 1.0)) if kind in ("decentre", "tilt") else (None,):
            if kind == FOCUS:
                continue
            size = step[kind]
            ends = [size, -size] if vector is None else [tuple(s * size * v for v in vector) for s in (1, -1)]
            plus, minus = (Errors(**{kind: {number: each}}) for each in ends)
            both = [exact(seen, LINE, wave, each).change[:, lit] for each in (plus, minus)]
            wanted = (both[0] - both[1]) / 2
            told = first_order(found, plus)[:, lit]
            wanted, told = wanted - wanted[:, :1].mean(), told - told[:, :1].mean()
            largest = float(wanted.abs().max())
            assert float((told - wanted).abs().max()) < 0.01 * largest + 1e-13


def test_a_decentred_perfect_lens_moves_its_image_and_does_nothing_else():
    """By (dx, dy): the path to where the image was grows by the shift times the direction cosine."""
    lens = perfect()
    seen, wave = seen_of(lens, 0.0)
    errors = Errors({0: (0.002, -0.003)})
    made = exact(seen, LINE, wave, errors)
    change, a, b = made.change, made.a, made.b
    found = slopes(seen, LINE)
    lit = found.rays.inside[0]
    scale = float(found.rays.half[0]) / lens.held().scale
    for told in (change, first_order(found, errors)):
        wanted = (0.002 * a - 0.003 * b) * scale
        assert float((told - wanted)[:, lit].abs().max()) < 2e-7
    assert float(wanted.abs().max()) > 1e-4


def test_a_tilted_plate_delays_each_direction_by_its_own_path():
    """A plane wave gains t (sqrt(n^2 - sin^2 i) - cos i) in a plate; turned about x by w, the ray's cosine
    with its normal (0, -sin w, cos w) is another."""
    lens = perfect(plate=True)
    n, t, turn = 1.6, 3.0, 2e-3
    seen, wave = seen_of(lens, 0.0)
    errors = Errors(tilt={1: (turn, 0.0)})
    found = slopes(seen, LINE)
    made = exact(seen, LINE, wave, errors)
    change, a, b = made.change, made.a, made.b
    lit, scale = found.rays.inside[0], float(found.rays.half[0]) / lens.held().scale
    slant = found.rays.slant[0]

    def gained(cosine):
        return t * (torch.sqrt(n * n - 1 + cosine.square()) - cosine)

    # rays go from the place on the sphere to its centre
    along = torch.sqrt(1 - scale**2 * (a.square() + b.square()))
    cosine = along * math.cos(turn) + scale * b * math.sin(turn)
    wanted = gained(cosine) - gained(along)
    wanted = wanted - wanted[:, :1]
    # fixed place or fixed direction: the plate's aberration makes these differ a little
    assert float((change - wanted)[:, lit].abs().max()) < 0.02 * float(wanted[:, lit].abs().max())
    told = first_order(found, errors)
    assert float((told - change)[:, lit].abs().max()) < 0.01 * float(wanted[:, lit].abs().max())
    assert slant.shape == told.shape[1:]


def test_a_longer_way_between_lenses_moves_the_focus_as_paraxial_rays_say():
    lens = lens_of("double-gauss-50mm-f4")
    held = lens.held()
    seen, _ = seen_of(lens, 0.0)
    found = slopes(seen, LINE)
    index = held.lens.index(torch.tensor([LINE], dtype=torch.float64))[0]
    gap, longer = 4, 1e-3
    thickness = held.lens.thickness.clone()
    thickness[gap] += longer
    before, after = (
        paraxial(each, index).image(held.distance - held.first.entrance)[0]
        for each in (held.lens, replace(held.lens, thickness=thickness))
    )
    told = first_order(found, Errors(spacing={gap: longer}))[0]
    radius = torch.hypot(found.rays.a[0], found.rays.b[0]) * found.rays.half[0]
    near = (radius > 0) & (radius < 0.15 * found.rays.half[0])
    # an image farther behind leaves the sensor nearer than it: the wave is r^2 / 2 (1/z_i - 1/z_image) longer
    wanted = (after - before) / held.scale**2 * radius[near].square() / 2
    torch.testing.assert_close(told[near], wanted, rtol=0.02, atol=0)


def test_a_sensor_farther_back_is_what_focus_says():
    lens = lens_of("doublet-25mm-f6")
    held, back = lens.held(), 1e-3
    seen, _ = seen_of(lens, 0.0)
    found = slopes(seen, LINE)
    radius = torch.hypot(found.rays.a[0], found.rays.b[0]) * found.rays.half[0]
    told = first_order(found, Errors(focus=back))[0]
    lit = found.rays.inside[0]
    wanted = back * (torch.sqrt(1 - (radius / held.scale).square()) - 1)
    torch.testing.assert_close(told[lit], wanted[lit], rtol=1e-6, atol=1e-12)


def test_polynomials_of_both_sides_hold_tilts_of_either_sign():
    lens = lens_of("double-gauss-50mm-f4")
    seen, wave = seen_of(lens, 0.06)
    rays = slopes(seen, LINE).rays
    made = exact(seen, LINE, wave, Errors({0: (0.02, 0.01)}, {2: (1e-3, -5e-4)}))
    change, lit, poly = made.change, rays.inside.expand(2, -1), made.fitted()
    terms = basis(made.a, made.b)
    at = (terms @ poly.even + made.a[..., None] * (terms @ poly.odd))[..., 0]
    waves = (at - change)[lit].abs().max() / (LINE / MM)
    assert float(waves) < 1e-3
    assert float(change[0][lit[0]].sub(change[1][lit[1]]).abs().max() / (LINE / MM)) > 0.5


def test_errors_turn_with_the_place_in_the_field():
    """A place to the right of the axis (turn 0): along the field is right, across it is down."""
    errors = Errors({0: (1.0, 2.0)}, {0: (3.0, 4.0)}).turned(0.0, 1.0)
    assert errors.decentre[0] == (-2.0, 1.0)
    assert errors.tilt[0] == (-4.0, 3.0)
    assert Errors({0: (1.0, 2.0)}).turned(1.0, 0.0).decentre[0] == (1.0, 2.0)  # above: nothing turns
    assert (SPACING, TILT) == ("spacing", "tilt")
