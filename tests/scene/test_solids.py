"""Meshes of simple solids against their closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from edofsim.scene import solids
from edofsim.scene.model import TriangleMesh

LINE = np.linspace([0, 0, 0], [1, 0.2, 0.1], 20)
ANGLE = np.linspace(0, 2 * np.pi, 400, endpoint=False)
RING = np.stack([np.cos(ANGLE), np.sin(ANGLE), 0 * ANGLE], axis=1)

SECTION = np.stack([np.zeros(400), 0.2 * np.sin(ANGLE), 0.3 * np.cos(ANGLE)], axis=1)

CLOSED = {
    "box": (solids.box((1, 2, 3), (4, 5, 6)), 6.0),
    "sphere": (solids.sphere(0.7, 256), 4 / 3 * np.pi * 0.343),
    "hexagonal prism": (solids.prism(6, 1.0, 2.0), 3 * np.sqrt(3)),
    "capped tube": (solids.tube(LINE, 0.05, 64), np.pi * 0.0025 * np.linalg.norm(LINE[-1])),
    "torus": (solids.tube(RING, 0.1, 64, closed=True), 2 * np.pi**2 * 0.01),
    "elliptic loft": (
        solids.loft(SECTION + np.linspace(0, 1, 9)[:, None, None] * [1, 0, 0]),
        np.pi * 0.06,
    ),
    "cup": (
        solids.lathe([(0, 0), (1, 0), (1, 2), (0.9, 2), (0.9, 0.1), (0, 0.1)], 256),
        np.pi * (2 - 0.81 * 1.9),
    ),
}


def face_normals(mesh: TriangleMesh) -> np.ndarray:
    a, b, c = (mesh.vertices[mesh.faces[:, i]].astype(float) for i in range(3))
    return np.cross(b - a, c - a)


@pytest.mark.parametrize("name", CLOSED)
def test_volume_of_closed_solids(name: str):
    """The divergence theorem gives the volume, with a plus sign only if faces point outward."""
    mesh, volume = CLOSED[name]
    assert solids.signed_volume(mesh) == pytest.approx(volume, rel=2e-3)


@pytest.mark.parametrize("name", CLOSED)
def test_shading_normals_point_outward_with_their_faces(name: str):
    mesh, _ = CLOSED[name]
    if mesh.normals is not None:
        np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1, atol=1e-5)
        assert ((face_normals(mesh)[:, None] * mesh.normals[mesh.faces]).sum(-1) > 0).all()


def test_a_panel_faces_the_camera_and_its_picture_is_upright():
    mesh = solids.panel(2, 1)
    assert (face_normals(mesh)[:, 2] < 0).all()
    for vertex, uv in zip(mesh.vertices, mesh.uv, strict=True):
        assert (vertex[0] > 0) == (uv[0] == 1) and (vertex[1] > 0) == (uv[1] == 1)


def test_texture_of_a_turned_body_runs_rightwards_in_front():
    """u grows with x on the side that the camera sees, so that lettering is not mirrored."""
    mesh = solids.sphere(1.0, 64)
    front = mesh.vertices[:, 2] < -0.8
    assert np.corrcoef(mesh.vertices[front, 0], mesh.uv[front, 0])[0, 1] > 0.9


def test_moving_turns_normals_with_the_surface():
    mesh = solids.sphere(1.0, 32)
    stretch = np.diag([1.0, 2.0, 3.0])
    moved = solids.moved(mesh, stretch, (1, 2, 3))
    # the normal of the ellipsoid x^2 + (y/2)^2 + (z/3)^2 = 1 is along its gradient
    gradient = (moved.vertices - [1, 2, 3]) / np.array([1, 4, 9])
    gradient /= np.linalg.norm(gradient, axis=1, keepdims=True)
    np.testing.assert_allclose(moved.normals, gradient, atol=1e-5)


@pytest.mark.parametrize("closed", [False, True])
@pytest.mark.parametrize("count", [3, 4, 5, 9, 40])
def test_a_smooth_path_is_the_spline_of_scipy(count: int, closed: bool) -> None:
    from scipy.interpolate import CubicSpline

    points = np.random.default_rng(count).normal(size=(count, 3))
    through = np.concatenate([points, points[:1]]) if closed else points
    chords = np.linalg.norm(np.diff(through, axis=0), axis=1)
    knots = np.concatenate([[0], np.cumsum(np.sqrt(chords))])
    spline = CubicSpline(knots, through, bc_type="periodic" if closed else "natural")
    expected = spline(np.linspace(0, knots[-1], 12 * len(through)))
    found = solids.smooth_path(points, closed)
    np.testing.assert_allclose(found, expected[:-1] if closed else expected, atol=1e-13)
