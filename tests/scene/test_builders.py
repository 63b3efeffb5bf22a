"""Every builder: finite triangles with an area, usable texture coordinates, shared surfaces."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from edofsim.recipe.kinds import OBJECTS
from edofsim.recipe.scene import SceneRecipe
from edofsim.scene import build_scene, solids

AT = {"depth_m": 1.0}
EXAMPLES = json.loads(Path(__file__).parents[1].joinpath("small", "objects.json").read_text())
SOLID = {"box", "sphere", "cylinder", "bust", "wire", "mesh", "goblet", "prism", "bus", "car"}
TETRA = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


def recipe(*objects: dict, **more) -> SceneRecipe:
    lights = more.pop("lights", [{"kind": "environment"}])
    return SceneRecipe.model_validate({"name": "test", "objects": list(objects), "lights": lights, **more})


def build(kind: str, folder: Path, **more):
    (folder / "good.obj").write_text(TETRA)
    return build_scene(recipe({"kind": kind, **EXAMPLES[kind], **more}), folder)


def test_there_is_an_example_of_each():
    assert set(EXAMPLES) == set(OBJECTS)


@pytest.mark.parametrize("kind", EXAMPLES)
def test_geometry_is_sound(kind: str, tmp_path: Path):
    for item in build(kind, tmp_path).objects:
        mesh = item.mesh
        assert mesh.vertices.dtype == np.float32 and mesh.faces.dtype == np.uint32
        assert np.isfinite(mesh.vertices).all() and mesh.faces.max() < len(mesh.vertices)
        a, b, c = (mesh.vertices[mesh.faces[:, i]].astype(float) for i in range(3))
        assert (np.linalg.norm(np.cross(b - a, c - a), axis=1) > 0).all(), item.name
        for per_vertex, width in ((mesh.uv, 2), (mesh.normals, 3)):
            assert per_vertex is None or per_vertex.shape == (len(mesh.vertices), width)
            assert per_vertex is None or np.isfinite(per_vertex).all()
        if mesh.normals is not None:
            np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1, atol=1e-4)


@pytest.mark.parametrize("kind", sorted(SOLID))
def test_solids_face_outward_after_placement(kind: str, tmp_path: Path):
    """Signed volume about the solid's own middle: positive where faces point outward, on a turned object."""
    for item in build(kind, tmp_path, turn_deg=30, tilt_deg=-20, roll_deg=10).objects:
        centred = solids.moved(item.mesh, shift=-item.mesh.vertices.mean(axis=0))
        assert solids.signed_volume(centred) > 0


@pytest.mark.parametrize("kind", sorted(SOLID | {"mug"} - {"bus", "car"}))
def test_solids_are_closed_to_the_last_bit(kind: str, tmp_path: Path):
    """Every edge has two faces once equal vertices are one: a renderer may take back faces for insides."""
    mesh = build(kind, tmp_path, x_mm=0).objects[0].mesh
    _, place = np.unique(mesh.vertices, axis=0, return_inverse=True)
    corners = place.reshape(-1)[mesh.faces.astype(int)]
    edges = np.sort(np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]]), axis=1)
    edges = edges[edges[:, 0] != edges[:, 1]]
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()


@pytest.mark.parametrize("kind", EXAMPLES)
def test_reflectances_are_between_0_and_1(kind: str, tmp_path: Path):
    model = build(kind, tmp_path)
    for item in model.objects:
        texture = item.surface.reflectance
        assert texture.basis.dtype == np.float32 and texture.basis.shape[1] == len(model.wavelengths)
        image = np.ones((1, 1, 1)) if texture.image is None else texture.image
        assert image.shape[-1] == texture.basis.shape[0] <= 3
        values = image.reshape(-1, image.shape[-1])[::97] @ texture.basis
        assert values.min() >= 0 and values.max() <= 1 + 1e-5


def test_the_same_seed_gives_the_same_bytes_and_another_seed_another_bust(tmp_path: Path):
    item = {"kind": "bust", "detail": 32, **AT}
    first, again, other = (
        build_scene(recipe(item, seed=seed), tmp_path).objects[0].mesh.vertices for seed in (3, 3, 4)
    )
    assert first.tobytes() == again.tobytes() != other.tobytes()


def test_a_new_object_leaves_the_others_as_they_were(tmp_path: Path):
    bust = {"kind": "bust", "detail": 32, "name": "bust", **AT}
    ball = {"kind": "sphere", "radius_mm": 5, **AT}
    alone, together = (
        next(o for o in build_scene(recipe(*items), tmp_path).objects if o.name == "bust")
        for items in ((bust,), (ball, bust))
    )
    assert alone.mesh.vertices.tobytes() == together.mesh.vertices.tobytes()


def test_a_bust_is_one_closed_piece(tmp_path: Path):
    """Euler's formula for a closed surface without holes, V - E + F = 2, needs one component too."""
    import trimesh

    mesh = build("bust", tmp_path, detail=96).objects[0].mesh
    shape = trimesh.Trimesh(mesh.vertices, mesh.faces, process=True)
    assert shape.is_watertight and shape.body_count == 1 and shape.euler_number == 2


def test_equal_surfaces_share_one_dictionary(tmp_path: Path):
    """The renderer compiles one program a BSDF; the 24 patches of the chart must not be 24 of them."""
    model = build("color_checker", tmp_path)
    assert len(model.objects) == 25 and len({id(o.surface.bsdf) for o in model.objects}) == 1
