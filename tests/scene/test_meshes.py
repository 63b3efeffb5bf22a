"""Meshes of the user's in every format: size, handedness, texture coordinates, what is mended."""

from __future__ import annotations

import contextlib
import os
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh

from edofsim.errors import InputError
from edofsim.recipe.scene import SceneRecipe
from edofsim.scene import build_scene, solids
from edofsim.scene.mesh_files import read_mesh
from edofsim.scene.model import TriangleMesh


def ell() -> trimesh.Trimesh:
    """An L of three cubes: right-handed x right, y up, z to the viewer; no mirror image of it is itself."""
    cubes = []
    for shift in ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (0, 0, 2)):
        cube = trimesh.creation.box((1, 1, 1))
        cube.apply_translation(shift)
        cubes.append(cube)
    return trimesh.util.concatenate(cubes)


def imported(folder: Path, name: str, **more) -> TriangleMesh:
    item = {"kind": "mesh", "path": name, "size_mm": 30, "depth_m": 1.0, "anchor": "centre", **more}
    recipe = SceneRecipe.model_validate(
        {"name": "own", "objects": [item], "lights": [{"kind": "environment"}]}
    )
    return build_scene(recipe, folder).objects[0].mesh


@pytest.mark.parametrize("suffix", ["obj", "ply", "glb", "stl"])
def test_every_format_arrives_in_size_and_the_right_way_round(tmp_path: Path, suffix: str):
    """The longest side (3, along z) becomes 30 mm; the arm along +x stays right, +y up, +z comes nearer."""
    ell().export(tmp_path / f"ell.{suffix}")
    vertices = imported(tmp_path, f"ell.{suffix}").vertices * 1e3 - [0, 0, 1000]
    np.testing.assert_allclose(np.ptp(vertices, axis=0), [20, 20, 30], atol=1e-3)
    near = vertices[vertices[:, 2] < -6]  # only the arm towards the viewer reaches there
    assert near[:, 0].max() < 0.1 and near[:, 1].max() < 0.1
    right = vertices[vertices[:, 0] > 0.1]
    assert right[:, 1].max() < 0.1 and right[:, 2].min() > 4.9


def test_faces_point_outward_whatever_the_file_has(tmp_path: Path):
    ball = trimesh.creation.icosphere(subdivisions=2)
    for name, faces in (("good.obj", ball.faces), ("inside_out.obj", ball.faces[:, ::-1])):
        trimesh.Trimesh(ball.vertices, faces, process=False).export(tmp_path / name)
        mesh = solids.moved(imported(tmp_path, name), shift=(0, 0, -1))
        assert solids.signed_volume(mesh) == pytest.approx(4 / 3 * np.pi * 0.015**3, rel=0.06)
        assert (mesh.normals * mesh.vertices).sum(axis=1).min() > 0


def test_duplicate_and_degenerate_faces_are_dropped(tmp_path: Path):
    text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 5 5 5\nf 1 2 3\nf 1 2 3\nf 1 1 2\n"
    (tmp_path / "a.obj").write_text(text)
    mesh = read_mesh(tmp_path / "a.obj", "thing")
    assert len(mesh.faces) == 1 and len(mesh.vertices) == 3


def test_texture_coordinates_are_kept(tmp_path: Path):
    text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n"
    (tmp_path / "a.obj").write_text(text)
    mesh = read_mesh(tmp_path / "a.obj", "thing")
    np.testing.assert_allclose(mesh.uv, mesh.vertices[:, :2])


def test_flat_shading_has_no_normals(tmp_path: Path):
    ell().export(tmp_path / "ell.stl")
    assert imported(tmp_path, "ell.stl", smooth=False).normals is None


@pytest.fixture
def no_guessing(monkeypatch):
    """trimesh's optional library that guesses encodings is not there, as after a plain installation."""
    monkeypatch.setitem(sys.modules, "charset_normalizer", None)


def test_latin_1_in_names_and_comments(tmp_path: Path, no_guessing):
    (tmp_path / "b\u00fc.mtl").write_bytes(b"# B\xfccher\nnewmtl b\xfc\nKd 1 0 0\n")
    text = b"# B\xfccher\nmtllib b\xc3\xbc.mtl\nusemtl b\xfc\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
    (tmp_path / "a.obj").write_bytes(text.replace(b"\xc3\xbc.mtl", b"\xfc.mtl"))
    assert len(read_mesh(tmp_path / "a.obj", "thing").faces) == 1


@pytest.mark.parametrize("suffix", ["stl", "ply", "glb", "gltf", "off"])
def test_garbled_files_are_called_so(tmp_path: Path, suffix: str, no_guessing):
    (tmp_path / f"a.{suffix}").write_bytes(bytes(range(128, 256)) * 9)
    with pytest.raises(InputError, match="cannot be read as a mesh: (?!No module)"):
        read_mesh(tmp_path / f"a.{suffix}", "thing")


def test_pipes_beside_a_mesh_are_not_waited_for(tmp_path: Path):
    os.mkfifo(tmp_path / "a.mtl")
    (tmp_path / "a.obj").write_text("mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    with contextlib.suppress(InputError):
        read_mesh(tmp_path / "a.obj", "thing")
    os.mkfifo(tmp_path / "b.obj")
    with pytest.raises(InputError, match="does not exist"):
        read_mesh(tmp_path / "b.obj", "thing")
