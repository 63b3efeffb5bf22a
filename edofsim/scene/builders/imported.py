"""Meshes of the user's: read by trimesh, mended where that changes nothing one can see, else refused."""

from __future__ import annotations

import io
import logging
import re
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from ...errors import InputError
from ...recipe.base import Positive
from ...recipe.placed import Placed
from ...recipe.surfaces import AnySurface, MattSurface
from .. import solids
from ..model import TriangleMesh
from .context import Builder, Context, Part

if TYPE_CHECKING:
    import trimesh

LOG = logging.getLogger(__name__)

SUFFIXES = (".obj", ".ply", ".glb", ".gltf", ".stl", ".off")


class MeshFile(Builder, Placed):
    """A mesh of yours (OBJ, PLY, GLB, STL); the path is relative to the recipe's folder.

    The file's axes are taken as x right, y up, z towards the viewer, as most programs write them."""

    kind: Literal["mesh"]
    path: str
    """mesh file (OBJ, PLY, GLB, STL), relative to the recipe's folder"""
    size_mm: Positive
    """longest side of the bounding box after scaling"""
    surface: AnySurface = MattSurface(kind="matt")
    """what it is made of"""
    smooth: bool = True
    """whether normals are interpolated across faces"""
    allow_outside: bool = False
    """whether the mesh's file may name files outside its own folder"""

    def build(self, context: Context) -> list[Part]:
        """The file's triangles about the centre of their bounding box, scaled to `size_mm`."""
        shape = read_mesh(context.base / self.path, context.what, self.smooth, self.allow_outside)
        low, high = shape.vertices.min(axis=0), shape.vertices.max(axis=0)
        scale = self.size_mm * 1e-3 / float((high - low).max())
        # files have z towards the viewer, camera space away from it: in z alone, nothing is mirrored
        flip = np.diag([1.0, 1.0, -1.0]) * scale
        centred = solids.moved(shape, shift=-(low + high) / 2)
        return [Part("", solids.moved(centred, flip), context.surface(self.surface))]


def read_mesh(path: Path, what: str, smooth: bool = True, allow_outside: bool = False) -> TriangleMesh:
    """A mesh file as triangles in the file's own axes and units.

    allow_outside: whether files that it names may lie outside its folder.

    Duplicate and degenerate faces and stray vertices are dropped; a closed mesh that is inside out is
    turned. Raises InputError, naming `what`, for a missing or unreadable file, for one without triangles,
    and for vertices that are not finite.
    """
    if not path.is_file():
        raise InputError(f"{what}: the mesh {str(path)!r} does not exist")
    if path.suffix.lower() not in SUFFIXES:
        raise InputError(f"{what}: {str(path)!r} is not of a known kind; known: {', '.join(SUFFIXES)}")
    import trimesh

    logging.getLogger("trimesh").setLevel(logging.CRITICAL)  # what it says is for its own users

    class _Beside(trimesh.resolvers.FilePathResolver):
        """Files that the mesh names."""

        def get(self, name: str) -> bytes:
            inner = self.absolute(name)
            if inner.exists() and not inner.is_file():
                raise ValueError(f"{name!r} is no ordinary file")
            return _as_utf8(inner, super().get(name))

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            near = _Beside(str(path), allow_anywhere=allow_outside)
            loaded = trimesh.load(
                io.BytesIO(_absolute_indices(path, _as_utf8(path, path.read_bytes()))),
                file_type=path.suffix[1:].lower(),
                force="mesh",
                process=False,
                resolver=near,
            )
    except ModuleNotFoundError as error:  # trimesh would guess the encoding of what is neither
        raise InputError(
            f"{what}: {str(path)!r} cannot be read as a mesh: it is damaged, or not of the kind that "
            "its name says"
        ) from error
    except Exception as error:  # each reader raises its own kinds
        if "escapes resolver root" in str(error):
            raise InputError(
                f"{what}: the mesh {str(path)!r} names a file outside its folder; set allow_outside = true "
                "beside its path if you trust it"
            ) from error
        text = (str(error).strip() or type(error).__name__).splitlines()[0][:160]
        raise InputError(f"{what}: {str(path)!r} cannot be read as a mesh: {text}") from error
    vertices = np.asarray(getattr(loaded, "vertices", np.empty((0, 3))), float)
    faces = np.asarray(getattr(loaded, "faces", np.empty((0, 3))), np.int64)
    if vertices.shape[1:] != (3,) or faces.shape[1:] != (3,):
        raise InputError(
            f"{what}: the mesh {str(path)!r} has faces or vertices without three numbers each; export it "
            "again as triangles"
        )
    if not isinstance(loaded, trimesh.Trimesh) or len(faces) == 0 or len(vertices) == 0:
        raise InputError(f"{what}: the mesh {str(path)!r} has no triangles")
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise InputError(f"{what}: faces of the mesh {str(path)!r} name vertices that it doesn't have")
    bad = int((~np.isfinite(vertices)).any(axis=1).sum())
    if bad:
        raise InputError(
            f"{what}: {bad} of the {len(vertices)} vertices of the mesh {str(path)!r} are not finite (NaN or "
            "infinity); mend the file in the program that wrote it"
        )
    return _mended(loaded, path, what, smooth)


def _as_utf8(path: Path, content: bytes) -> bytes:
    """Text files of meshes in UTF-8: older programs write Latin-1, in names and comments."""
    if path.suffix.lower() not in (".obj", ".mtl", ".off"):
        return content
    try:
        content.decode("utf-8")
    except UnicodeDecodeError:
        return content.decode("latin-1").encode("utf-8")
    return content


def _absolute_indices(path: Path, content: bytes) -> bytes:
    """An OBJ file whose faces count their corners from the front. A negative number counts back from the last
    corner so far (Wavefront's specification of OBJ), where trimesh counts from the end of the file."""
    if path.suffix.lower() != ".obj" or not re.search(rb"(?m)^\s*f\s.*-\d", content):
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
        if part.startswith(b"-") and part[1:].isdigit():
            parts[place] = b"%d" % (count + 1 + int(part))
    return b"/".join(parts)


def _say_what_is_left(loaded: trimesh.Trimesh, path: Path, what: str) -> None:
    """A line each for what of the file is not used."""
    dropped = len(loaded.faces) - int((loaded.nondegenerate_faces() & loaded.unique_faces()).sum())
    if dropped:
        LOG.warning(
            "%s: %d of the %d faces of %s are duplicates or have no area: they are left out",
            *(what, dropped, len(loaded.faces), path.name),
        )
    visual = loaded.visual
    material = getattr(visual, "material", None)
    names = ("baseColorTexture", "image")
    pictured = any(getattr(material, name, None) is not None for name in names)
    kind = None if visual is None else visual.kind
    if kind in ("vertex", "face") or pictured:
        found = "a picture" if pictured else f"colours of its {'corners' if kind == 'vertex' else 'faces'}"
        LOG.warning(
            "%s: %s brings %s, which %s not used: the object's `surface` is; for a picture give it "
            'texture = { kind = "file", path = ... }',
            *(what, path.name, found, "is" if pictured else "are"),
        )


def _mended(loaded: trimesh.Trimesh, path: Path, what: str, smooth: bool) -> TriangleMesh:
    _say_what_is_left(loaded, path, what)
    loaded.update_faces(loaded.nondegenerate_faces())
    loaded.update_faces(loaded.unique_faces())
    loaded.remove_unreferenced_vertices()
    size = np.ptp(loaded.vertices, axis=0).max() if len(loaded.vertices) else 0.0
    if len(loaded.faces) == 0 or not size > 0:
        raise InputError(f"{what}: the mesh {str(path)!r} has no triangle with an area")
    uv = getattr(loaded.visual, "uv", None)
    if uv is not None and (len(uv) != len(loaded.vertices) or not np.isfinite(uv).all()):
        uv = None
    if uv is None:  # vertices that lie on each other become one, so that shading is smooth across them
        loaded.merge_vertices()
    if loaded.is_watertight and loaded.volume < 0:
        loaded.invert()
    normals = None
    if smooth:
        normals = np.array(loaded.vertex_normals)
        length = np.linalg.norm(normals, axis=1, keepdims=True)
        normals = np.where(length > 0, normals / np.maximum(length, 1e-12), [0.0, 1.0, 0.0])
    return solids.mesh(loaded.vertices, loaded.faces, uv, normals)
