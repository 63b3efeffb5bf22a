"""Nothing of a mesh file is lost in silence: corners counted from behind, faces, colours."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from edofsim.core.words import counted
from edofsim.errors import InputError
from edofsim.scene.mesh_files import read_content, read_mesh
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


@pytest.mark.parametrize("seed", range(50))
def test_polygons_that_are_not_convex_are_counted(
    tmp_path: Path, seed: int, caplog: pytest.LogCaptureFixture
):
    """Polygons of random corners on a circle are convex; one corner moved over the middle bends them."""
    draw = np.random.default_rng(seed)
    lines, hollow, count = [], [], 0
    for _ in range(int(draw.integers(1, 6))):
        corners = int(draw.integers(4, 8))
        angle = (np.arange(corners) + draw.uniform(0, 0.3, corners)) * 2 * np.pi / corners
        circle = np.stack([np.cos(angle), np.sin(angle), np.full(corners, draw.uniform())], axis=1)
        hollow.append(draw.random() < 0.5)
        if hollow[-1]:
            circle[draw.integers(corners), :2] *= -0.02 if corners > 4 else -0.4
        turn = np.linalg.qr(draw.normal(size=(3, 3)))[0]
        lines += [f"v {x} {y} {z}" for x, y, z in circle @ turn]
        lines.append("f " + " ".join(str(count + k + 1) for k in range(corners)))
        count += corners
    (tmp_path / "m.obj").write_text("\n".join(lines))
    vertices = [line[2:] for line in lines if line[0] == "v"]
    faces = [[int(k) - 1 for k in line.split()[1:]] for line in lines if line[0] == "f"]
    listed = [f"{len(face)} " + " ".join(map(str, face)) for face in faces]
    body = "\n".join([*vertices, *listed]) + "\n"
    (tmp_path / "m.off").write_text(f"OFF\n{len(vertices)} {len(faces)} 0\n{body}")
    axes = "".join(f"property float {axis}\n" for axis in "xyz")
    head = f"element vertex {len(vertices)}\n{axes}element face {len(faces)}\n"
    head += "property list uchar int vertex_indices\nend_header\n"
    (tmp_path / "m.ply").write_text(f"ply\nformat ascii 1.0\n{head}{body}")
    same = [face for face in faces if len(face) == len(faces[0])]
    numbers = np.array([line.split() for line in vertices], "<f4").tobytes()
    numbers += b"".join(bytes([len(face)]) + np.array(face, "<i4").tobytes() for face in same)
    head = head.replace(f"face {len(faces)}", f"face {len(same)}")
    (tmp_path / "b.ply").write_bytes(f"ply\nformat binary_little_endian 1.0\n{head}".encode() + numbers)
    alike = sum(flag for flag, face in zip(hollow, faces, strict=True) if len(face) == len(faces[0]))
    for name, bent in (
        ("m.obj", sum(hollow)),
        ("m.off", sum(hollow)),
        ("m.ply", sum(hollow)),
        ("b.ply", alike),
    ):
        caplog.clear()
        read_mesh(tmp_path / name, "mesh")
        assert (f"{counted(bent, 'polygon')} not convex" in caplog.text) == (bent > 0), name
        assert ("not convex" in caplog.text) == (bent > 0), name


def gltf(folder: Path, change: Callable[[dict], None]) -> Path:
    """A box as glTF, changed."""
    trimesh.creation.box().export(folder / "m.gltf")
    tree = json.loads((folder / "m.gltf").read_text())
    change(tree)
    (folder / "m.gltf").write_text(json.dumps(tree))
    return folder / "m.gltf"


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda tree: tree.update(extensionsUsed=["KHR_texture_transform"]), "not moved"),
        (lambda tree: tree.update(skins=[{"joints": [0]}]), "skins are not applied"),
        (
            lambda tree: tree["meshes"][0]["primitives"].append(
                {**tree["meshes"][0]["primitives"][0], "mode": 6}
            ),
            "1 of 2 pieces",
        ),
    ],
)
def test_what_of_gltf_is_not_applied_is_named(
    tmp_path: Path, change: Callable[[dict], None], said: str, caplog: pytest.LogCaptureFixture
):
    read_mesh(gltf(tmp_path, change), "mesh")
    assert said in caplog.text


@pytest.mark.parametrize("suffix", ["glb", "gltf"])
def test_extensions_that_are_required_and_unknown_are_named(tmp_path: Path, suffix: str):
    tree = json.dumps({"asset": {"version": "2.0"}, "extensionsRequired": ["EXT_meshopt_compression"]})
    binary = chunked(tree.encode() + b" " * (-len(tree) % 4))
    (tmp_path / f"m.{suffix}").write_bytes(binary if suffix == "glb" else tree.encode())
    with pytest.raises(InputError, match="requires EXT_meshopt_compression"):
        read_mesh(tmp_path / f"m.{suffix}", "mesh")


def chunked(tree: bytes) -> bytes:
    """A GLB file of that JSON alone."""
    length = [number.to_bytes(4, "little") for number in (2, 20 + len(tree), len(tree))]
    return b"glTF" + length[0] + length[1] + length[2] + b"JSON" + tree


@pytest.mark.parametrize("lost", ["m.mtl", "board.png"])
def test_files_that_a_mesh_names_and_that_are_missing_are_named(
    tmp_path: Path, lost: str, caplog: pytest.LogCaptureFixture
):
    Image.new("RGB", (4, 4), (200, 10, 10)).save(tmp_path / "board.png")
    (tmp_path / "m.mtl").write_text("newmtl a\nmap_Kd board.png\n")
    text = "mtllib m.mtl\nusemtl a\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n"
    (tmp_path / "m.obj").write_text(text)
    assert read_content(tmp_path / "m.obj", "mesh").paint.any and not caplog.text
    (tmp_path / lost).write_bytes(b"no picture")
    if lost.endswith("mtl"):
        (tmp_path / lost).unlink()
    assert not read_content(tmp_path / "m.obj", "mesh").paint.any
    assert lost in caplog.text
