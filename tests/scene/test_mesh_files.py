"""Nothing of a mesh file is lost in silence: corners counted from behind, faces, colours."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from edofsim.scene.builders.imported import read_mesh
from edofsim.scene.model import TriangleMesh


def area(mesh: TriangleMesh) -> float:
    corners = mesh.vertices[mesh.faces].astype(float)
    return float(
        np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum()
        / 2
    )


@pytest.mark.parametrize("seed", range(50))
def test_faces_may_count_their_corners_from_the_last_one_so_far(tmp_path: Path, seed: int):
    """Quads one after the other, in random order of corners, texture and normals; area by hand, and the same
    file with numbers from the front."""
    draw = np.random.default_rng(seed)
    back, front, total = [], [], 0.0
    for quad in range(int(draw.integers(1, 6))):
        size = draw.uniform(0.1, 2, 2)
        corners = np.array([(0, 0, quad), (size[0], 0, quad), (*size, quad), (0, size[1], quad)])
        total += float(size.prod())
        lines = [f"v {x} {y} {z}" for x, y, z in corners]
        textured, with_normal = draw.random(2) < 0.5
        lines += ["vt 0 0", "vt 1 0", "vt 1 1", "vt 0 1"] * bool(textured) + ["vn 0 0 1"] * 4 * bool(
            with_normal
        )
        numbers = {"back": [-4, -3, -2, -1], "front": [4 * quad + k for k in (1, 2, 3, 4)]}
        texture_front = sum("vt" in line for line in front) // 1
        normal_front = sum("vn" in line for line in front)
        for which, into in (("back", back), ("front", front)):
            into += lines
            words = []
            for k, number in enumerate(numbers[which]):
                vt = (-4 + k if which == "back" else texture_front + k + 1) if textured else ""
                vn = f"/{-4 + k if which == 'back' else normal_front + k + 1}" if with_normal else ""
                words.append(f"{number}/{vt}{vn}" if textured or with_normal else f"{number}")
            into.append("f " + " ".join(words))
    (tmp_path / "back.obj").write_text("\n".join(back))
    (tmp_path / "front.obj").write_text("\n".join(front))
    found, same = (read_mesh(tmp_path / name, "mesh") for name in ("back.obj", "front.obj"))
    assert area(found) == pytest.approx(total, rel=1e-5)
    np.testing.assert_allclose(found.vertices, same.vertices)
    assert (found.uv is None) == (same.uv is None)
    if found.uv is not None:
        np.testing.assert_allclose(found.uv, same.uv)


def test_faces_that_are_left_out_are_counted(tmp_path: Path, caplog: pytest.LogCaptureFixture):
    (tmp_path / "m.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 2 0 0\nf 1 2 3\nf 1 2 3\nf 1 2 4\n")
    assert len(read_mesh(tmp_path / "m.obj", "mesh").faces) == 1
    assert "2 of the 3 faces of m.obj" in caplog.text


@pytest.mark.parametrize("kind", ["vertex", "face", "none"])
def test_colours_that_are_not_used_are_named(tmp_path: Path, kind: str, caplog: pytest.LogCaptureFixture):
    box = trimesh.creation.box()
    if kind == "vertex":
        box.visual.vertex_colors = np.random.default_rng(0).integers(0, 255, (len(box.vertices), 4), np.uint8)
    if kind == "face":
        box.visual.face_colors = np.random.default_rng(0).integers(0, 255, (len(box.faces), 4), np.uint8)
    box.export(tmp_path / "m.ply")
    read_mesh(tmp_path / "m.ply", "mesh")
    assert ("which are not used" in caplog.text) == (kind != "none")
