"""What mesh files say of their colours: pictures, colours of corners and faces, of materials."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from PIL import Image

from ..core.images import srgb_decode
from ..core.limits import check_pixels
from ..errors import InputError
from . import solids
from .model import BandTexture, TriangleMesh
from .spectra import srgb_basis

if TYPE_CHECKING:
    import trimesh
    from trimesh.visual.base import Visuals

    Part: TypeAlias = tuple[trimesh.Trimesh, Visuals]

LOG = logging.getLogger(__name__)

LINEAR = (".glb", ".gltf")
"""Formats whose colours are linear light but for pictures (glTF 2.0, 3.9.2); the others' are sRGB, as most
programs show them."""
UNUSED = (("normalTexture", "normals"), ("metallicRoughnessTexture", "gloss"), ("emissiveTexture", "light"))
"""Pictures of a material that no reflectance is made of."""
UNPAINTED = 0.5
"""Reflectance of a painted mesh's faces that the file gives no colour."""


@dataclass(frozen=True)
class Paint:
    """How a file paints faces, in linear RGB.

    corners: float32 [face, corner, 3], NaN where it says nothing.
    picture: number of the picture that each face has, int [face], -1 for none.
    pictures: float32 [y, x, 3] each.
    uv: float32 [vertex, 2], NaN where there are none.
    """

    corners: np.ndarray
    picture: np.ndarray
    pictures: tuple[np.ndarray, ...]
    uv: np.ndarray

    @property
    def any(self) -> bool:
        """Whether the file gives any face a colour."""
        return bool((self.picture >= 0).any()) or bool(np.isfinite(self.corners).any())


def paint_of(parts: list[Part], path: Path, what: str) -> Paint:
    """What a file says of the colours of all its parts, one after the other.

    parts: where each lies, and what it looks like in the file.

    Raises InputError for pictures that are damaged or too large.
    """
    linear = path.suffix.lower() in LINEAR
    pictures: dict[tuple[int, tuple[float, ...]], tuple[int, np.ndarray]] = {}
    corners: list[np.ndarray] = []
    picture: list[np.ndarray] = []
    uvs: list[np.ndarray] = []
    left: dict[str, None] = {}
    for mesh, visual in parts:
        uv = _uv(mesh, visual)
        colours, image, factor = _said(mesh, visual, linear, left)
        number = -1
        if image is not None and np.isfinite(uv).all():
            key = (id(image), tuple(factor))
            if key not in pictures:
                pictures[key] = (len(pictures), _decoded(image, path, what, left) * factor.astype(np.float32))
            number = pictures[key][0]
        elif image is not None:
            left["a picture without coordinates"] = None
        uvs.append(uv)
        corners.append(colours)
        picture.append(np.full(len(mesh.faces), number))
    if left:
        LOG.warning("%s: of %s is not used: %s", what, path.name, ", ".join(left))
    return Paint(
        np.concatenate(corners),
        np.concatenate(picture),
        tuple(image for _, image in pictures.values()),
        np.concatenate(uvs),
    )


def _uv(mesh: trimesh.Trimesh, visual: Visuals) -> np.ndarray:
    uv = getattr(visual, "uv", None)
    if uv is None or np.shape(uv) != (len(mesh.vertices), 2):
        return np.full((len(mesh.vertices), 2), np.nan, np.float32)
    return np.asarray(uv, np.float32)


def _said(
    mesh: trimesh.Trimesh, visual: Visuals, linear: bool, left: dict[str, None]
) -> tuple[np.ndarray, Image.Image | None, np.ndarray]:
    """Colours of a part's corners, its picture, and what to multiply that by."""
    colours = np.full((len(mesh.faces), 3, 3), np.nan, np.float32)
    if visual.kind == "vertex" and len(visual.vertex_colors) == len(mesh.vertices):
        return _light(visual.vertex_colors, linear)[mesh.faces], None, np.ones(3)
    if visual.kind == "face" and len(visual.face_colors) == len(mesh.faces):
        return np.repeat(_light(visual.face_colors, linear)[:, None], 3, axis=1), None, np.ones(3)
    material = getattr(visual, "material", None)
    if visual.kind != "texture" or material is None:
        return colours, None, np.ones(3)
    for name, of in UNUSED:
        if getattr(material, name, None) is not None:
            left[f"its picture of {of}"] = None
    if not hasattr(material, "baseColorFactor"):  # of an OBJ or PLY file
        image = None if material.image is None or _is_stand_in(material.image) else material.image
        if image is None and "kd" in material.kwargs:
            colours[:] = _light(material.diffuse, linear)
        return colours, image, np.ones(3)
    stated = material.baseColorFactor
    factor = np.ones(3) if stated is None else _light(stated, True)
    image = material.baseColorTexture
    own = visual.vertex_attributes.get("color")
    if image is not None:
        if own is not None:
            left["colours of corners where there is a picture"] = None
        return colours, image, factor
    if own is not None and len(own) == len(mesh.vertices):
        return (_light(own, True) * factor)[mesh.faces], None, factor
    if stated is not None:
        colours[:] = factor
    return colours, None, factor


def _is_stand_in(image: Image.Image) -> bool:
    """Whether it is the picture that trimesh gives a material of which it knows nothing."""
    from trimesh.visual.material import empty_material

    stand_in = empty_material().image
    assert isinstance(stand_in, Image.Image)
    return image.size == stand_in.size and image.convert("RGB").tobytes() == stand_in.convert("RGB").tobytes()


def _light(colours: np.ndarray, linear: bool) -> np.ndarray:
    """Colours [..., 3 or 4] of whole numbers to their type's largest, or of floats to 1, as linear RGB."""
    values = np.asarray(colours)[..., :3]
    full = np.iinfo(values.dtype).max if values.dtype.kind in "ui" else 1.0
    values = np.nan_to_num(values / full).clip(0, 1)
    return (values if linear else srgb_decode(values)).astype(np.float32)


def _decoded(image: Image.Image, path: Path, what: str, left: dict[str, None]) -> np.ndarray:
    """A picture that a mesh brings, float32 [y, x, 3] linear; its opacity does not count."""
    columns, rows = image.size
    check_pixels(rows, columns, path, what)
    try:
        if "A" in image.getbands() and image.getchannel("A").getextrema() != (255, 255):
            left["the opacity of its picture"] = None
        return _light(np.asarray(image.convert("RGB")), False)
    except Exception as error:  # Pillow raises nearly anything
        raise InputError(f"{what}: a picture of {str(path)!r} cannot be read: {error}") from error


def painted_parts(
    mesh: TriangleMesh, paint: Paint, wavelengths: np.ndarray
) -> list[tuple[TriangleMesh, BandTexture]]:
    """A mesh in pieces of one reflectance each: those of every picture, and all others.

    wavelengths: [band], metres.
    """
    basis = srgb_basis(wavelengths).astype(np.float32)
    pieces = []
    for number, image in enumerate(paint.pictures):
        faces = mesh.faces[paint.picture == number]
        if len(faces):
            used, inverse = np.unique(faces, return_inverse=True)
            normals = None if mesh.normals is None else mesh.normals[used]
            piece = solids.mesh(mesh.vertices[used], inverse.reshape(-1, 3), paint.uv[used], normals)
            pieces.append((piece, BandTexture(basis, image)))
    rest = paint.picture < 0
    if rest.any():
        pieces.append(_by_corners(mesh, rest, np.nan_to_num(paint.corners[rest], nan=UNPAINTED), basis))
    return pieces


def _by_corners(
    mesh: TriangleMesh, faces: np.ndarray, colours: np.ndarray, basis: np.ndarray
) -> tuple[TriangleMesh, BandTexture]:
    """Faces whose corners have colours: each has four texels of a picture of its own, the middles of three of
    which are its corners, so that bilinear interpolation is linear within it.

    faces: bool [face of the mesh]; colours: float32 [face, corner, 3]."""
    chosen = mesh.faces[faces]
    if (colours == colours[0, 0]).all():
        used, inverse = np.unique(chosen, return_inverse=True)
        normals = None if mesh.normals is None else mesh.normals[used]
        piece = solids.mesh(mesh.vertices[used], inverse.reshape(-1, 3), None, normals)
        return piece, BandTexture((colours[0, 0] @ basis)[None].astype(np.float32))
    across = int(np.ceil(np.sqrt(len(chosen))))
    down = -(-len(chosen) // across)
    row, column = np.divmod(np.arange(len(chosen)), across)
    first, second, third = colours.swapaxes(0, 1)
    image = np.zeros((down, 2, across, 2, 3), np.float32)
    image[row, 0, column, 0], image[row, 0, column, 1], image[row, 1, column, 0] = first, second, third
    image[row, 1, column, 1] = second + third - first
    u = (2 * column[:, None] + np.array([0.5, 1.5, 0.5])) / (2 * across)
    v = 1 - (2 * row[:, None] + np.array([0.5, 0.5, 1.5])) / (2 * down)
    corners = chosen.ravel()
    normals = None if mesh.normals is None else mesh.normals[corners]
    piece = solids.mesh(
        mesh.vertices[corners],
        np.arange(len(corners)).reshape(-1, 3),
        np.stack([u, v], axis=-1).reshape(-1, 2),
        normals,
    )
    return piece, BandTexture(basis, image.reshape(2 * down, 2 * across, 3))
