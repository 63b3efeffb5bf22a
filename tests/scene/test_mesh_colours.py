"""The colours of a mesh's file are those of its surface: of corners, faces and materials, and pictures."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from edofsim.core.images import srgb_decode
from edofsim.errors import InputError
from edofsim.recipe.scene import SceneRecipe
from edofsim.scene import build_scene
from edofsim.scene.mesh_colours import painted_parts
from edofsim.scene.mesh_files import read_content, read_mesh
from edofsim.scene.model import BandTexture, TriangleMesh
from edofsim.scene.spectra import srgb_basis

WAVES = np.linspace(450e-9, 650e-9, 5)
CELL, CELLS = 8, 3
KINDS = (
    "corners.ply",
    "corners.glb",
    "corners.obj",
    "faces.ply",
    "material.obj",
    "material.glb",
    "corners and material.glb",
    "corners, mirrored.glb",
    "picture.obj",
    "picture.glb",
    "picture and factor.glb",
)
UNIT = np.array([(0, 0), (1, 0), (0, 1)], float)


def sampled(texture: BandTexture, uv: np.ndarray) -> np.ndarray:
    """Values [point, band] at uv [point, 2], bilinear between the middles of texels, repeated."""
    if texture.image is None:
        return np.repeat(texture.basis[:1], len(uv), axis=0)
    rows, columns = texture.image.shape[:2]
    at = np.stack([(1 - uv[:, 1]) * rows, uv[:, 0] * columns], axis=1) - 0.5
    low = np.floor(at).astype(int)
    share = at - low
    found = np.zeros((len(uv), texture.image.shape[2]))
    for down in (0, 1):
        for right in (0, 1):
            weight = np.abs(1 - down - share[:, 0]) * np.abs(1 - right - share[:, 1])
            texel = texture.image[(low[:, 0] + down) % rows, (low[:, 1] + right) % columns]
            found += weight[:, None] * texel
    return found @ texture.basis


def triangles(count: int) -> trimesh.Trimesh:
    """Triangles one behind the other, each at z = its number."""
    vertices = np.concatenate([np.column_stack([UNIT, np.full(3, z)]) for z in range(count)])
    return trimesh.Trimesh(vertices, np.arange(3 * count).reshape(-1, 3), process=False)


def board(draw: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Colours of cells and a picture of them, uint8."""
    cells = draw.integers(0, 256, (CELLS, CELLS, 3), np.uint8)
    return cells, np.kron(cells, np.ones((CELL, CELL, 1), np.uint8))


def write(folder: Path, kind: str, draw: np.random.Generator) -> tuple[Path, np.ndarray]:
    """A file, and the linear colours that its triangles' corners have [face, corner, 3]."""
    count = int(draw.integers(1, 9))
    mesh = triangles(count)
    what, suffix = kind.split(".")
    path = folder / f"m.{suffix}"
    colours = draw.integers(0, 256, (count, 3, 4), np.uint8)
    colours[..., 3] = 255
    if what.startswith("corners") and "material" not in what:
        mesh.visual.vertex_colors = colours.reshape(-1, 4)
        mirror = np.diag([1, 1, -1 if "mirrored" in what else 1, 1])
        scene = trimesh.Scene()
        scene.add_geometry(mesh, transform=mirror)
        (scene if suffix == "glb" else mesh).export(path)
        unit = colours[..., :3] / 255
        return path, unit if suffix == "glb" else srgb_decode(unit)
    if what == "faces":
        mesh.visual.face_colors = colours[:, 0]
        mesh.export(path)
        return path, np.repeat(srgb_decode(colours[:, :1, :3] / 255), 3, axis=1)
    cells, picture = board(draw)
    place = draw.integers(0, CELLS, (count, 2))
    inner = draw.uniform(0.3, 0.7, (count, 3, 2))  # away from the borders of cells
    uv = np.stack(
        [(place[:, None, 1] + inner[..., 0]) / CELLS, 1 - (place[:, None, 0] + inner[..., 1]) / CELLS],
        axis=-1,
    ) + draw.integers(-1, 2, (count, 1, 2))
    of_cells = np.repeat(srgb_decode(cells[place[:, 0], place[:, 1]] / 255)[:, None], 3, axis=1)
    factor = draw.integers(0, 256, 3) / 255
    if suffix == "obj":
        return path, of_obj(folder, colours[:, 0, :3], uv, picture, what == "picture", of_cells)
    material = trimesh.visual.material.PBRMaterial()
    if what in ("material", "corners and material", "picture and factor"):
        material.baseColorFactor = [*factor, 1.0]
    if what.startswith("picture"):
        material.baseColorTexture = Image.fromarray(picture)
    mesh.visual = trimesh.visual.TextureVisuals(uv.reshape(-1, 2), material)
    if what == "corners and material":
        mesh.visual.vertex_attributes["color"] = colours.reshape(-1, 4)
    mesh.export(path)
    if what == "corners and material" and b"COLOR_0" not in path.read_bytes():
        add_colours(path, colours.reshape(-1, 4))
    flat = np.broadcast_to(factor, (count, 3, 3))
    return path, {
        "material": flat,
        "corners and material": flat * colours[..., :3] / 255,
        "picture": of_cells,
        "picture and factor": of_cells * factor,
    }[what]


def add_colours(path: Path, colours: np.ndarray) -> None:
    """COLOR_0 for the only primitive of a GLB file."""
    content = path.read_bytes()
    length = int.from_bytes(content[12:16], "little")
    tree, binary = json.loads(content[20 : 20 + length]), content[28 + length :]
    tree["bufferViews"].append({"buffer": 0, "byteOffset": len(binary), "byteLength": colours.nbytes})
    tree["accessors"].append({
        "bufferView": len(tree["bufferViews"]) - 1, "componentType": 5121, "count": len(colours),
        "type": "VEC4", "normalized": True,
    })  # fmt: skip
    tree["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = len(tree["accessors"]) - 1
    binary += colours.tobytes()
    tree["buffers"][0]["byteLength"] = len(binary)
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    chunks = b"".join([
        len(text).to_bytes(4, "little"), b"JSON", text, len(binary).to_bytes(4, "little"), b"BIN\0", binary
    ])  # fmt: skip
    path.write_bytes(b"glTF" + (2).to_bytes(4, "little") + (12 + len(chunks)).to_bytes(4, "little") + chunks)


def of_obj(
    folder: Path, kd: np.ndarray, uv: np.ndarray, picture: np.ndarray, pictured: bool, of_cells: np.ndarray
) -> np.ndarray:
    """An OBJ file whose materials take turns, and their colours."""
    Image.fromarray(picture).save(folder / "board.png")
    lines, materials = ["mtllib m.mtl"], []
    for number, colour in enumerate(kd):
        lines += [f"v {x} {y} {number}" for x, y in UNIT] + [f"vt {u} {v}" for u, v in uv[number]]
        corners = " ".join(f"{3 * number + k}/{3 * number + k}" for k in (1, 2, 3))
        lines += [f"usemtl {'board' if pictured else number}", f"f {corners}"]
        materials.append(f"newmtl {number}\nKd {' '.join(map(str, colour / 255))}")
    materials.append("newmtl board\nmap_Kd board.png")
    (folder / "m.obj").write_text("\n".join(lines))
    (folder / "m.mtl").write_text("\n".join(materials))
    return of_cells if pictured else np.repeat(srgb_decode(kd / 255)[:, None], 3, axis=1)


def check(
    pieces: list[tuple[TriangleMesh, BandTexture]], wanted: np.ndarray, draw: np.random.Generator
) -> int:
    """Spectra at random points of all faces; returns how many faces there were."""
    faces = 0
    for piece, texture in pieces:
        for face in piece.faces:
            weight = draw.dirichlet(np.ones(3), 5)
            x, y, z = (weight @ piece.vertices[face]).T
            uv = np.zeros((5, 2)) if piece.uv is None else weight @ piece.uv[face]
            colour = np.stack([1 - x - y, x, y], axis=-1) @ wanted[abs(round(float(z[0])))]
            np.testing.assert_allclose(sampled(texture, uv), colour @ srgb_basis(WAVES), atol=0.004)
            faces += 1
    return faces


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", range(6))
def test_surfaces_have_the_colours_of_the_file(tmp_path: Path, kind: str, seed: int):
    draw = np.random.default_rng(seed)
    path, wanted = write(tmp_path, kind, draw)
    content = read_content(path, "mesh")
    assert content.paint.any
    pieces = painted_parts(content.mesh, content.paint, WAVES)
    assert check(pieces, wanted, draw) == len(wanted)


def test_a_solid_that_is_turned_keeps_the_colours_at_their_corners(tmp_path: Path):
    box = trimesh.creation.box()
    colours = np.random.default_rng(0).integers(0, 256, (8, 4), np.uint8)
    trimesh.Trimesh(box.vertices, box.faces[:, ::-1], vertex_colors=colours, process=False).export(
        tmp_path / "m.ply"
    )
    content = read_content(tmp_path / "m.ply", "mesh")
    ((piece, texture),) = painted_parts(content.mesh, content.paint, WAVES)
    near = np.linalg.norm(piece.vertices[:, None] - box.vertices[None], axis=-1).argmin(axis=1)
    np.testing.assert_allclose(
        sampled(texture, piece.uv), srgb_decode(colours[near, :3] / 255) @ srgb_basis(WAVES), atol=1e-3
    )


def scene(folder: Path, surface: dict[str, object] | None):
    item = {"kind": "mesh", "path": "m.ply", "size_mm": 30, "depth_m": 1.0}
    item |= {} if surface is None else {"surface": surface}
    recipe = SceneRecipe.model_validate(
        {"name": "own", "objects": [item], "lights": [{"kind": "environment"}]}
    )
    return build_scene(recipe, folder).objects[0].surface


def test_the_recipe_says_whose_colours_are_taken(tmp_path: Path, caplog: pytest.LogCaptureFixture):
    box = trimesh.creation.box()
    box.visual.vertex_colors = np.arange(32, dtype=np.uint8).reshape(8, 4) * 8
    box.export(tmp_path / "m.ply")
    assert scene(tmp_path, None).reflectance.image is not None
    glossy = scene(tmp_path, {"kind": "plastic", "texture": {"kind": "mesh"}})
    assert glossy.bsdf["type"] == "roughplastic" and glossy.reflectance.image is not None
    assert "colours" not in caplog.text
    own = scene(tmp_path, {"kind": "matt", "reflectance": 0.3})
    assert own.reflectance.image is None and "colours of m.ply are not used" in caplog.text


def test_colours_of_a_file_are_for_meshes_alone(tmp_path: Path):
    item = {"kind": "panel", "width_mm": 10, "height_mm": 10, "depth_m": 1.0,
            "surface": {"kind": "matt", "texture": {"kind": "mesh"}}}  # fmt: skip
    recipe = SceneRecipe.model_validate(
        {"name": "own", "objects": [item], "lights": [{"kind": "environment"}]}
    )
    with pytest.raises(InputError, match="no such file"):
        build_scene(recipe, tmp_path)


def test_what_no_reflectance_is_made_of_is_named(tmp_path: Path, caplog: pytest.LogCaptureFixture):
    mesh = triangles(2)
    picture = Image.new("RGBA", (4, 4), (10, 200, 30, 40))
    material = trimesh.visual.material.PBRMaterial(baseColorTexture=picture, normalTexture=picture)
    mesh.visual = trimesh.visual.TextureVisuals(np.tile(UNIT, (2, 1)), material)
    mesh.export(tmp_path / "m.glb")
    read_mesh(tmp_path / "m.glb", "mesh")
    assert "its picture of normals" in caplog.text and "the opacity of its picture" in caplog.text
