"""Small scenes made by hand, so that these tests depend on no recipe and no builder."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from edofsim.render.engine import use_engine
from edofsim.render.settings import RenderSettings
from edofsim.scene.model import BandTexture, Environment, SceneModel, SceneObject, Surface, TriangleMesh


def wavelengths(bands=31):
    return np.linspace(420e-9, 720e-9, bands)


def flat(value, bands=31):
    """A reflectance or radiance without texture: a number, or one value a band."""
    return BandTexture(np.broadcast_to(np.asarray(value, np.float32), (1, bands)).copy())


def quad(corners, uv=None):
    """Two triangles; corners in the order of the right-hand rule about the normal."""
    return TriangleMesh(
        np.asarray(corners, np.float32),
        np.array([[0, 1, 2], [0, 2, 3]], np.uint32),
        None if uv is None else np.asarray(uv, np.float32),
    )


def facing(width, height, z, x=0.0, y=0.0):
    """A rectangle that faces the camera, texture upright."""
    left, right, low, high = x - width / 2, x + width / 2, y - height / 2, y + height / 2
    corners = [(left, low, z), (left, high, z), (right, high, z), (right, low, z)]
    return quad(corners, [(0, 0), (0, 1), (1, 1), (1, 0)])


def sphere(radius, centre, rings=48):
    """A closed sphere with smooth normals; vertices at the poles and the seam are shared."""
    polar = np.linspace(0, np.pi, rings + 1)[1:-1]
    around = np.arange(2 * rings) * np.pi / rings
    body = np.stack(
        [
            np.outer(np.sin(polar), np.cos(around)),
            np.outer(np.cos(polar), np.ones_like(around)),
            np.outer(np.sin(polar), np.sin(around)),
        ],
        axis=-1,
    ).reshape(-1, 3)
    normals = np.concatenate([body, [[0, 1, 0], [0, -1, 0]]])
    n, top, bottom = 2 * rings, len(body), len(body) + 1
    faces = []
    for ring in range(rings - 2):
        for k in range(n):
            a, b = ring * n + k, ring * n + (k + 1) % n
            faces += [(a, b, a + n), (b, b + n, a + n)]
    for k in range(n):
        faces += [(top, (k + 1) % n, k), (bottom, (rings - 2) * n + k, (rings - 2) * n + (k + 1) % n)]
    vertices = normals * radius + np.asarray(centre)
    return TriangleMesh(
        vertices.astype(np.float32), np.array(faces, np.uint32), None, normals.astype(np.float32)
    )


def matt(value, bands=31):
    return Surface(
        {"type": "diffuse"}, "reflectance", value if isinstance(value, BandTexture) else flat(value, bands)
    )


def thing(name, mesh, surface, emission=None):
    return SceneObject(name, mesh, surface, None if emission is None else np.asarray(emission, np.float32))


def model(objects, sky=None, bands=31):
    environment = (
        None if sky is None else Environment(sky if isinstance(sky, BandTexture) else flat(sky, bands))
    )
    return SceneModel("test", wavelengths(bands), tuple(objects), environment)


def settings(width=16, height=12, margin=0, angle=0.01, **more):
    return RenderSettings(height=height, width=width, margin=margin, pixel_angle=angle, **more)


@pytest.fixture(scope="session")
def mi():
    """Mitsuba with the engine that this machine has."""
    return use_engine("cpu")


@pytest.fixture(scope="session")
def make():
    """What the tests build scenes from."""
    return SimpleNamespace(
        wavelengths=wavelengths,
        flat=flat,
        quad=quad,
        facing=facing,
        sphere=sphere,
        matt=matt,
        thing=thing,
        model=model,
        settings=settings,
        surface=Surface,
        texture=BandTexture,
    )
