"""Mesh files: read by trimesh, mended where that changes nothing one can see, else refused."""

from __future__ import annotations

import io
import json
import logging
import re
import warnings
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from PIL import Image

from ..core.json_values import Json
from ..core.words import counted
from ..errors import InputError
from . import solids
from .mesh_colours import Paint, paint_of
from .model import TriangleMesh

if TYPE_CHECKING:
    import trimesh

    from .mesh_colours import Part

LOG = logging.getLogger(__name__)

PICTURES = (".png", ".jpg", ".jpeg", ".tga", ".bmp", ".tif", ".tiff", ".webp", ".gif")
SUFFIXES = (".obj", ".ply", ".glb", ".gltf", ".stl", ".off")
MOST_FACES = 1 << 26
"""Of all the copies that a file places."""
DRACO = "KHR_draco_mesh_compression"
GLTF_KNOWN = ("KHR_mesh_quantization", "KHR_materials_", "KHR_texture_transform", "EXT_texture_webp",
              "KHR_lights_punctual", DRACO)  # fmt: skip
"""glTF extensions, by their beginnings, that leave triangles as they are, or that trimesh reads."""


@dataclass(frozen=True)
class MeshContent:
    """What a mesh file holds: its triangles, and how it paints them."""

    mesh: TriangleMesh
    paint: Paint


def read_mesh(path: Path, what: str, smooth: bool = True, allow_outside: bool = False) -> TriangleMesh:
    """The triangles of `read_content`."""
    return read_content(path, what, smooth, allow_outside).mesh


def read_content(path: Path, what: str, smooth: bool = True, allow_outside: bool = False) -> MeshContent:
    """A mesh file in its own axes and units.

    smooth: whether there are normals.
    allow_outside: whether files that it names may lie outside its folder.

    Duplicate and degenerate faces and stray vertices are dropped; a closed mesh that is inside out is
    turned. Raises InputError, naming `what`, for a missing or unreadable file, for one without triangles,
    and for vertices that are not finite.
    """
    if not path.is_file():
        raise InputError(f"{what}: the mesh {str(path)!r} does not exist")
    if path.suffix.lower() not in SUFFIXES:
        raise InputError(f"{what}: {str(path)!r} is not of a known kind; known: {', '.join(SUFFIXES)}")
    content = _as_utf8(path, path.read_bytes())
    if path.suffix.lower() == ".obj":
        content = absolute_indices(content)
        _say(path, what, _bent(not_convex_of_obj(content)))
    if path.suffix.lower() == ".off":
        content, bent = read_off(content)
        _say(path, what, _bent(bent))
    if path.suffix.lower() in (".glb", ".gltf"):
        _say(path, what, _of_gltf(path, content, what))
    parts = _parts(path, content, what, allow_outside)
    if not parts:
        raise InputError(f"{what}: the mesh {str(path)!r} has no triangles")
    for mesh, _ in parts:
        _check(mesh, path, what)
    found = _mended(parts, path, what, smooth)
    if b'"baseColorTexture"' in content and not found.paint.pictures:
        _say(path, what, ["its picture of colours cannot be read"])
    return found


def _parts(path: Path, content: bytes, what: str, allow_outside: bool) -> list[Part]:
    """The meshes of a file where it places them, with what each looks like."""
    import trimesh

    missing: dict[str, None] = {}
    logging.getLogger("trimesh").setLevel(logging.CRITICAL)  # what it says is for its own users

    class _SameFolder(trimesh.resolvers.FilePathResolver):
        """Files that the mesh names."""

        def get(self, name: str) -> bytes:
            inner = self.absolute(name)
            if not inner.is_file():
                missing[name] = None
                raise FileNotFoundError(f"{name!r} is not there, or no ordinary file")
            content = _as_utf8(inner, super().get(name))
            if inner.suffix.lower() in PICTURES and not _is_picture(content):
                missing[f"{name}, which cannot be read"] = None
            return content

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            scene = trimesh.load_scene(
                io.BytesIO(content),
                file_type=path.suffix[1:].lower(),
                process=False,
                resolver=_SameFolder(str(path), allow_anywhere=allow_outside),
            )
            named = [scene.graph[node] for node in scene.graph.nodes_geometry]
            found = [(at, scene.geometry[name]) for at, name in named]
            placed = [(at, mesh) for at, mesh in found if isinstance(mesh, trimesh.Trimesh)]
            count = sum(len(mesh.faces) for _, mesh in placed)
            if count > MOST_FACES:
                raise ValueError(f"it places {count} faces, more than {MOST_FACES}")
            _say(path, what, [f"{', '.join(missing)} is missing"] if missing else [])
            parts: list[Part] = []
            raw = [mesh.metadata["_ply_raw"] for _, mesh in placed if "_ply_raw" in mesh.metadata]
            _say(path, what, _bent(sum(map(not_convex_of_ply, raw))))
            for at, mesh in placed:
                if len(mesh.faces) and mesh.visual is not None:
                    parts.append((mesh.copy(include_visual=False).apply_transform(at), mesh.visual))
            return parts
    except ModuleNotFoundError as error:  # trimesh would guess the encoding of what is neither
        raise InputError(
            f"{what}: {str(path)!r} cannot be read as a mesh: it is damaged, or not of the kind that "
            "its name says"
        ) from error
    except Exception as error:  # each reader raises its own kinds
        if "escapes resolver root" in str(error):
            raise InputError(
                f"{what}: the mesh {str(path)!r} names a file outside its folder; set allow_outside = true "
                "next to its path if you trust it"
            ) from error
        text = (str(error).strip() or type(error).__name__).splitlines()[0][:160]
        raise InputError(f"{what}: {str(path)!r} cannot be read as a mesh: {text}") from error


def _say(path: Path, what: str, lost: list[str]) -> None:
    if lost:
        LOG.warning("%s: of %s %s", what, path.name, "; ".join(lost))


def _bent(bent: int) -> list[str]:
    """What is said of polygons that are not convex."""
    advice = "not convex, but cut into triangles as if convex: triangulate where it was made"
    return [f"{counted(bent, 'polygon')} {advice}"] if bent else []


def _of_gltf(path: Path, content: bytes, what: str) -> list[str]:
    """What of a glTF file is not as it says. Raises InputError for an extension that is required, but not
    known."""
    if path.suffix.lower() == ".glb":
        content = content[20 : 20 + int.from_bytes(content[12:16], "little")]
    try:
        tree: Json = json.loads(content)
        required, used = ([str(n) for n in tree.get(f"extensions{key}", [])] for key in ("Required", "Used"))
        kinds = [p.get("mode", 4) for mesh in tree.get("meshes", []) for p in mesh["primitives"]]
        posed = len(tree.get("skins", []))
    except (ValueError, AttributeError, TypeError, KeyError, RecursionError):
        return []  # trimesh says what is wrong
    unknown = [name for name in required if not name.startswith(GLTF_KNOWN)]
    if DRACO in required and find_spec("DracoPy") is None:
        unknown.append(f"{DRACO} (pip install DracoPy)")
    if unknown:
        raise InputError(
            f"{what}: {str(path)!r} requires {', '.join(unknown[:6])}, which is not read; export it without"
        )
    others = sum(mode not in (4, 5) for mode in kinds)
    lost = [f"{others} of {len(kinds)} pieces are no triangles or strips of them: left out"] if others else []
    lost += ["pictures are not moved as KHR_texture_transform says"] * ("KHR_texture_transform" in used)
    return lost + ["skins are not applied: it is as it was modelled"] * bool(posed)


def _is_picture(content: bytes) -> bool:
    try:
        with Image.open(io.BytesIO(content)):
            return True
    except Exception:  # Pillow raises nearly anything
        return False


def _check(part: trimesh.Trimesh, path: Path, what: str) -> None:
    """Raises InputError for arrays that are no triangles of numbers."""
    vertices, faces = np.asarray(part.vertices, float), np.asarray(part.faces, np.int64)
    if vertices.shape[1:] != (3,) or faces.shape[1:] != (3,):
        raise InputError(
            f"{what}: the mesh {str(path)!r} has faces or vertices without three numbers each; export it "
            "again as triangles"
        )
    if len(vertices) == 0 or faces.min() < 0 or faces.max() >= len(vertices):
        raise InputError(f"{what}: faces of the mesh {str(path)!r} name vertices that it doesn't have")
    bad = int((~np.isfinite(vertices)).any(axis=1).sum())
    if bad:
        raise InputError(
            f"{what}: {bad} of the {len(vertices)} vertices of the mesh {str(path)!r} are not finite (NaN or "
            "infinity); mend the file in the program that wrote it"
        )


def _as_utf8(path: Path, content: bytes) -> bytes:
    """Text files of meshes in UTF-8: older programs write Latin-1, in names and comments."""
    if path.suffix.lower() not in (".obj", ".mtl", ".off"):
        return content
    try:
        content.decode("utf-8")
    except UnicodeDecodeError:
        return content.decode("latin-1").encode("utf-8")
    return content


def _mended(parts: list[Part], path: Path, what: str, smooth: bool) -> MeshContent:
    """All parts as one mesh, without what has no area."""
    import trimesh

    paint = paint_of(parts, path, what)
    for mesh, _ in parts:
        mesh.vertex_attributes.clear()
        mesh.face_attributes.clear()
    loaded = trimesh.util.concatenate([mesh for mesh, _ in parts])
    assert isinstance(loaded, trimesh.Trimesh)
    loaded.vertex_attributes["uv"] = paint.uv
    kept = loaded.nondegenerate_faces() & loaded.unique_faces()
    if not kept.all():
        LOG.warning(
            "%s: %d of the %d faces of %s are duplicates or have no area: they are left out",
            *(what, int((~kept).sum()), len(kept), path.name),
        )
    loaded.update_faces(kept)
    loaded.remove_unreferenced_vertices()
    size = np.ptp(loaded.vertices, axis=0).max() if len(loaded.vertices) else 0.0
    if len(loaded.faces) == 0 or not size > 0:
        raise InputError(f"{what}: the mesh {str(path)!r} has no triangle with an area")
    if not np.isfinite(loaded.vertex_attributes["uv"]).any():
        loaded.merge_vertices()  # those that lie on each other, so that shading is smooth across them
    corners = paint.corners[kept]
    if loaded.is_watertight and loaded.volume < 0:
        loaded.invert()
        corners = corners[:, ::-1]
    normals = None
    if smooth:
        normals = np.array(loaded.vertex_normals)
        length = np.linalg.norm(normals, axis=1, keepdims=True)
        normals = np.where(length > 0, normals / np.maximum(length, 1e-12), [0.0, 1.0, 0.0])
    uv = np.asarray(loaded.vertex_attributes["uv"])
    mesh = solids.mesh(loaded.vertices, loaded.faces, uv if np.isfinite(uv).all() else None, normals)
    return MeshContent(mesh, replace(paint, corners=corners, picture=paint.picture[kept], uv=uv))


def absolute_indices(content: bytes) -> bytes:
    """A file whose faces count their corners from the front. A negative number counts back from the last
    corner so far (Wavefront's specification of OBJ), where trimesh counts from the end of the file."""
    if not re.search(rb"(?m)^\s*f\s.*-\d", content):
        return content
    counts = {b"v": 0, b"vt": 0, b"vn": 0}
    lines = content.replace(b"\\\r\n", b" ").replace(b"\\\n", b" ").splitlines()
    for number, line in enumerate(lines):
        words = line.split()
        if words and words[0] in counts:
            counts[words[0]] += 1
        elif words and words[0] == b"f":
            lines[number] = b" ".join(
                [b"f", *(_absolute(corner, list(counts.values())) for corner in words[1:])]
            )
    return b"\n".join(lines) + b"\n"


def _absolute(corner: bytes, counts: Sequence[int]) -> bytes:
    """A corner of a face (vertex/texture/normal); counts: of each so far."""
    parts = corner.split(b"/")
    for place, (part, count) in enumerate(zip(parts, counts, strict=False)):
        if re.fullmatch(rb"-\d{1,9}", part):
            parts[place] = b"%d" % (count + 1 + int(part))
    return b"/".join(parts)


# trimesh cuts faces of more than three corners from their first corner, as if they were convex
def not_convex(vertices: np.ndarray, polygons: Iterable[Sequence[int]]) -> int:
    """How many polygons, by the numbers of their corners, are not convex.

    vertices: [vertex, 3].
    """
    by_count: dict[int, list[Sequence[int]]] = {}
    for corners in polygons:
        if len(corners) > 3:
            by_count.setdefault(len(corners), []).append(corners)
    vertices = np.where(np.isfinite(vertices), vertices, 0)
    found = 0
    for same in by_count.values():
        index = np.array(same, np.int64)
        index = index[((index >= 0) & (index < len(vertices))).all(axis=1)]
        corners = vertices[index]
        sides = np.roll(corners, -1, axis=1) - corners
        turns = np.cross(np.roll(sides, 1, axis=1), sides)
        normal = turns.sum(axis=1, keepdims=True)
        size = (sides**2).sum(axis=(1, 2), keepdims=True)
        found += int(((turns * normal).sum(-1, keepdims=True) < -1e-3 * size**2).any(axis=1).sum())
    return found


def not_convex_of_obj(content: bytes) -> int:
    """Of the text of an OBJ file, whose faces count their corners from the front."""
    faces = re.finditer(rb"(?m)^[ \t]*f((?:[ \t]+\d{1,9}(?:/[-\d/]*)?){4,})[ \t\r]*$", content)
    polygons = [[int(word.split(b"/")[0]) - 1 for word in face[1].split()] for face in faces]
    lines = re.findall(rb"(?m)^[ \t]*v[ \t]+(\S+)[ \t]+(\S+)[ \t]+(\S+)", content) if polygons else []
    return _counted(lines, polygons)


def read_off(content: bytes) -> tuple[bytes, int]:
    """The text of an OFF file, faces of more than four corners cut into triangles, as trimesh cannot, and how
    many polygons are not convex."""
    lines = [line.split(b"#")[0].split() for line in content.splitlines()]
    words = [line for line in lines if line and line != [b"OFF"]]
    if words and words[0][0] == b"OFF":
        words[0] = words[0][1:]
    try:
        count, faces = int(words[0][0]), int(words[0][1])
        vertices, listed = words[1 : 1 + count], words[1 + count : 1 + count + faces]
        polygons = [[int(word) for word in line[1 : 1 + int(line[0])]] for line in listed]
    except (IndexError, ValueError):
        return content, 0  # trimesh says what is wrong
    bent = _counted([line[:3] for line in vertices], polygons)
    if max((len(each) for each in polygons), default=0) <= 4:
        return content, bent
    fans = [(3, face[0], *pair) for face in polygons for pair in zip(face[1:-1], face[2:], strict=True)]
    body = [*(b" ".join(line[:3]) for line in vertices), *(b"%d %d %d %d" % fan for fan in fans)]
    return b"\n".join([b"OFF", b"%d %d 0" % (count, len(fans)), *body]) + b"\n", bent


def not_convex_of_ply(raw: Json) -> int:
    """Of what trimesh keeps of a PLY file, `_ply_raw` of its metadata."""
    try:
        vertex, face = raw["vertex"]["data"], raw["face"]["data"]
        name = next(name for name in ("vertex_indices", "vertex_index") if name in raw["face"]["properties"])
        listed = face[name]
        if getattr(listed.dtype, "names", None):  # binary: how many corners, and which
            listed = listed[listed.dtype.names[-1]]
        polygons = [np.ravel(corners).tolist() for corners in listed]
        lines = np.stack([np.asarray(vertex[axis], float).ravel() for axis in "xyz"], axis=1)
    except (KeyError, IndexError, StopIteration, ValueError, TypeError, AttributeError):
        return 0
    return not_convex(lines, polygons)


def _counted(lines: Sequence[Sequence[bytes]], polygons: Sequence[Sequence[int]]) -> int:
    try:
        return not_convex(np.array(lines, float).reshape(-1, 3), polygons)
    except ValueError:
        return 0  # trimesh says what is wrong
