"""Shapes, surfaces and lights of a Mitsuba scene, as far as many bands can share one path through them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ...core.images import read_picture, srgb_encode
from ...errors import InputError
from .. import solids, spectra
from ..mesh_files import read_mesh
from ..model import BandTexture, Surface, TriangleMesh
from ..pictures import read_hdr
from ..surfaces import settings
from ..textures import from_srgb, mixture
from .nodes import Colour, Node

_INDEX = {"vacuum": 1.0, "air": 1.000277, "water": 1.333, "bk7": 1.5046, "diamond": 2.419, "pyrex": 1.47,
          "acrylic glass": 1.49, "polypropylene": 1.49, "fused quartz": 1.458}  # fmt: skip
"""Refractive indices of named media, Mitsuba's table."""
SQUARE = 256
"""Texels of a checkerboard's square: Mitsuba's has sharp edges, texels are interpolated."""


class NotCarried(InputError):
    """The scene is sound, but holds what a path of many bands cannot carry; `problems` names all of it."""


@dataclass(frozen=True)
class Reader:
    """What the parts of one file share: its folder, whether it may name files elsewhere, bands, and what a
    light of RGB white looks like ([band])."""

    folder: Path
    allow_outside: bool
    wavelengths: np.ndarray
    white: np.ndarray

    def file(self, node: Node, what: str) -> Path:
        """Path of the node's file. Raises InputError for one outside the scene's folder."""
        return resolved(self.folder, str(node.values.get("filename", "")), self.allow_outside, what)


def resolved(folder: Path, name: str, allow_outside: bool, what: str) -> Path:
    """A file that a scene names. Raises InputError for none, and for one outside unless that is allowed."""
    if not name:
        raise InputError(f"{what} names no file")
    path = (folder / name).resolve()
    if not allow_outside and not path.is_relative_to(folder.resolve()):
        raise InputError(
            f"{what} names {name!r}, a file outside the scene's folder; set allow_outside = true in [source] "
            "if you trust the scene"
        )
    return path


# ---- shapes ------------------------------------------------------------------------------------------


def shape_mesh(node: Node, reader: Reader, what: str) -> TriangleMesh:
    """A shape in world units of the file. Raises InputError for kinds that have no triangles."""
    if node.type in ("obj", "ply"):
        local = read_mesh(reader.file(node, what), what, smooth=not node.values.get("face_normals", False))
        local = _upright(local, node)
    elif node.type in _SHAPES:
        local = _SHAPES[node.type](node)
    else:
        raise NotCarried(f"{what}: shapes of type {node.type!r} are Mitsuba's own")
    matrix = np.asarray(node.values.get("to_world", np.eye(4)))
    if not abs(np.linalg.det(matrix[:3, :3])) > 0:
        raise InputError(f"{what}: its to_world squeezes it flat")
    return solids.moved(local, matrix[:3, :3], matrix[:3, 3])


def _upright(mesh: TriangleMesh, node: Node) -> TriangleMesh:
    """v = 0 is the foot of a picture here, its head in Mitsuba, whose OBJ reader alone turns the file's v."""
    turned = node.values.get("flip_tex_coords", node.type == "obj")
    if mesh.uv is None or turned:
        return mesh
    return _turned_over(mesh)


def _turned_over(mesh: TriangleMesh) -> TriangleMesh:
    if mesh.uv is None:
        return mesh
    uv = mesh.uv * np.array([1, -1], np.float32) + np.array([0, 1], np.float32)
    return solids.mesh(mesh.vertices, mesh.faces, uv, mesh.normals)


def _rectangle(node: Node) -> TriangleMesh:
    """Mitsuba's rectangle spans -1 to 1 in x and y, faces +z, and has the picture's head at y = -1."""
    corners = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)])
    uv = (corners[:, :2] + 1) / 2 * [1, -1] + [0, 1]
    return solids.mesh(corners, np.array([[0, 1, 2], [0, 2, 3]]), uv)


def _cube(node: Node) -> TriangleMesh:
    """Mitsuba's cube spans -1 to 1; its corners in Mitsuba's own order, which places the textures."""
    sides = ("+-- +-+ --+ ---", "++- -+- -++ +++", "+-- ++- +++ +-+", "+-+ +++ -++ --+", "--+ -++ -+- ---",
             "++- +-- --- -+-")  # fmt: skip
    corners = np.array(
        [[1 if sign == "+" else -1 for sign in corner] for side in sides for corner in side.split()]
    )
    faces = (np.array([[0, 1, 2], [3, 0, 2]])[None] + 4 * np.arange(6)[:, None, None]).reshape(-1, 3)
    return solids.mesh(corners, faces, np.tile([(0, 0), (1, 0), (1, 1), (0, 1)], (6, 1)))


def _sphere(node: Node) -> TriangleMesh:
    """A ball with Mitsuba's coordinates: u around +z from +x, the picture's head at +z."""
    rows, columns = 129, 257
    theta = np.linspace(np.pi, 0, rows)[:, None]
    phi = np.linspace(0, 2 * np.pi, columns)[None]
    phi[:, -1] = 0  # to the last bit, so that the ball is closed
    out = np.stack(
        np.broadcast_arrays(np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)), axis=-1
    )
    out[[0, -1], :, :2] = 0
    u = np.linspace(0, 1, columns)[None]
    uv = np.stack(np.broadcast_arrays(u, 1 - theta / np.pi), axis=-1).reshape(-1, 2)
    normals = out.reshape(-1, 3)
    vertices = normals * float(node.values.get("radius", 1.0)) + _point(node, "center", (0, 0, 0))
    faces = solids.grid_faces(rows, columns)[:, ::-1]
    return solids.mesh(vertices, solids.without_degenerate(vertices, faces), uv, normals)


def _point(node: Node, key: str, default: tuple[float, float, float]) -> np.ndarray:
    """A point [3] of a shape. Raises InputError for another count of numbers."""
    point = np.asarray(node.values.get(key, default), float)
    if point.shape != (3,):
        raise InputError(f"{node.type}.{key}: a point needs 3 numbers, not {point.size}")
    return point


def _disk(node: Node) -> TriangleMesh:
    flat = solids.lathe([(1, 0), (0, 0)], 96)  # faces +y; turned to face +z
    turned = solids.moved(flat, np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]))
    return solids.mesh(turned.vertices, turned.faces, None, turned.normals)


def _cylinder(node: Node) -> TriangleMesh:
    """Mitsuba's cylinder is open at both ends."""
    ends = np.stack([_point(node, "p0", (0, 0, 0)), _point(node, "p1", (0, 0, 1))])
    tube = solids.tube(ends, float(node.values.get("radius", 1.0)), 96)
    side = (tube.faces < 2 * 97).all(axis=1)
    assert tube.normals is not None
    return solids.mesh(tube.vertices[:194], tube.faces[side], None, tube.normals[:194])


_SHAPES: dict[str, Callable[[Node], TriangleMesh]] = {
    "rectangle": _rectangle,
    "cube": _cube,
    "sphere": _sphere,
    "disk": _disk,
    "cylinder": _cylinder,
}


# ---- spectra and surfaces ----------------------------------------------------------------------------


def spectrum(colour: Colour, reader: Reader, light: bool, what: str) -> np.ndarray:
    """A colour at the bands, float64 [band]: RGB over Mallett's basis, for lights times what white is.
    Raises InputError for bands outside its spectrum."""
    if colour.rgb is not None:
        values = np.asarray(colour.rgb) @ spectra.srgb_basis(reader.wavelengths)
        return values * reader.white if light else values
    if colour.value is not None:
        return np.full(len(reader.wavelengths), colour.value)
    nm, values = np.array(colour.samples).T
    bands = reader.wavelengths * 1e9
    if bands.min() < nm[0] - 1e-6 or bands.max() > nm[-1] + 1e-6:
        raise InputError(
            f"{what}: its spectrum goes from {nm[0]:g} to {nm[-1]:g} nm, the bands from {bands.min():g} to "
            f"{bands.max():g} nm; choose bands inside it"
        )
    return np.interp(bands, nm, values)


def carrier(node: Node, key: str, default: float, reader: Reader, what: str) -> BandTexture:
    """A reflectance: a number, colour or texture of the node. Raises InputError for values outside [0, 1]."""
    texture = node.part(key)
    if texture is not None and texture.kind != "texture":
        raise NotCarried(f"{what}: its {key} is a {texture.type!r}")
    if texture is not None:
        return _texture(texture, reader, f"{what}, {key}")
    value = node.values.get(key, default)
    colour = value if isinstance(value, Colour) else Colour(value=float(value))
    values = spectrum(colour, reader, False, what)
    if values.min() < 0 or values.max() > 1 + 1e-6:
        raise InputError(f"{what}: its {key} must lie between 0 and 1")
    return BandTexture(values[None].astype(np.float32))


def _texture(node: Node, reader: Reader, what: str) -> BandTexture:
    if node.type == "bitmap":
        usual = (("filter_type", "bilinear"), ("wrap_mode", "repeat"))
        if other := [
            f"{key} = {node.values[key]}" for key, value in usual if node.values.get(key, value) != value
        ]:
            raise NotCarried(f"{what}: a bitmap with {', '.join(other)}")
        path = reader.file(node, what)
        if path.suffix.lower() in (".exr", ".hdr", ".pfm"):
            image = np.clip(read_hdr(path, what), 0, 1)
            return BandTexture(spectra.srgb_basis(reader.wavelengths).astype(np.float32), image)
        picture = read_picture(path, what)
        if node.values.get("raw", False):
            picture = _encoded(picture)
        return from_srgb(picture, reader.wavelengths)
    if node.type == "checkerboard":
        pair = []
        for key, default in (("color0", 0.4), ("color1", 0.2)):
            value = node.values.get(key, default)
            colour = value if isinstance(value, Colour) else Colour(value=float(value))
            pair.append(spectrum(colour, reader, False, what))
        # v = 0, which Mitsuba begins with, is a picture's head
        return mixture(np.kron([[0, 1], [1, 0]], np.ones((SQUARE, SQUARE))), *pair)
    raise NotCarried(f"{what}: textures of type {node.type!r} are Mitsuba's own")


def _encoded(picture: np.ndarray) -> np.ndarray:
    """Linear values written as sRGB, because that is what pictures are decoded from."""
    scale = np.iinfo(picture.dtype).max if picture.dtype.kind in "ui" else 1.0
    return srgb_encode(picture / scale)


def surface(node: Node, reader: Reader, what: str) -> Surface:
    """A BSDF. Raises InputError for what no single path can carry for all bands."""
    if node.type == "twosided":
        inner = node.of_kind("bsdf")
        if len(inner) != 1:
            raise NotCarried(f"{what}: twosided with {len(inner)} surfaces inside")
        return replace(surface(inner[0], reader, what), two_sided=True)
    if node.type not in _SURFACES:
        raise NotCarried(f"{what}: surfaces of type {node.type!r} need the spectral renderer")
    if node.values.get("nonlinear", False):
        raise NotCarried(
            f"{what}: nonlinear = true is not affine in the reflectance; need the spectral renderer"
        )
    return replace(_SURFACES[node.type](node, reader, what), two_sided=False)


def _floats(node: Node, **defaults: float) -> dict[str, float]:
    found = {}
    for key, default in defaults.items():
        value = node.values.get(key, default)
        if isinstance(value, str):
            if value.lower() not in _INDEX:
                raise InputError(f"{node.type}: the medium {value!r} is unknown; known: {', '.join(_INDEX)}")
            value = _INDEX[value.lower()]
        if isinstance(value, Colour):
            value = value.value if value.value is not None else float(np.mean(value.rgb or 0))
        found[key] = float(value)
    return found


def _diffuse(node: Node, reader: Reader, what: str) -> Surface:
    return Surface(settings(type="diffuse"), "reflectance", carrier(node, "reflectance", 0.5, reader, what))


def _plastic(node: Node, reader: Reader, what: str) -> Surface:
    numbers = _floats(node, int_ior=1.49, ext_ior=1.000277)
    if node.type == "roughplastic":
        numbers |= _floats(node, alpha=0.1)
        bsdf = settings(
            type="roughplastic", distribution=node.values.get("distribution", "beckmann"), **numbers
        )
    else:
        bsdf = settings(type="plastic", **numbers)
    return Surface(bsdf, "diffuse_reflectance", carrier(node, "diffuse_reflectance", 0.5, reader, what))


def _conductor(node: Node, reader: Reader, what: str) -> Surface:
    if "eta" in node.values or node.values.get("material", "none") != "none":
        raise NotCarried(f"{what}: a metal of some eta and k, whose reflectance changes with the angle")
    value = carrier(node, "specular_reflectance", 1.0, reader, what)
    if node.type == "conductor":
        return Surface(settings(type="conductor", material="none"), "specular_reflectance", value)
    distribution = node.values.get("distribution", "beckmann")
    bsdf = settings(
        type="roughconductor", material="none", distribution=distribution, **_floats(node, alpha=0.1)
    )
    return Surface(bsdf, "specular_reflectance", value)


def _dielectric(node: Node, reader: Reader, what: str) -> Surface:
    bsdf = settings(type=node.type, **_floats(node, int_ior=1.5046, ext_ior=1.000277))
    value = carrier(node, "specular_transmittance", 1.0, reader, what)
    return Surface(bsdf, "specular_transmittance", value)


def _principled(node: Node, reader: Reader, what: str) -> Surface:
    tints = [
        key for key in ("spec_tint", "sheen_tint", "flatness", "spec_trans") if node.values.get(key, 0.0)
    ]
    if tints:
        raise NotCarried(f"{what}: principled with {', '.join(tints)} need the spectral renderer")
    numbers = _floats(
        node, roughness=0.5, metallic=0.0, specular=0.5, clearcoat=0.0, clearcoat_gloss=0.0, sheen=0.0
    )
    return Surface(
        settings(type="principled", **numbers), "base_color", carrier(node, "base_color", 0.5, reader, what)
    )


_SURFACES: dict[str, Callable[[Node, Reader, str], Surface]] = {
    "diffuse": _diffuse,
    "plastic": _plastic,
    "roughplastic": _plastic,
    "conductor": _conductor,
    "roughconductor": _conductor,
    "dielectric": _dielectric,
    "thindielectric": _dielectric,
    "principled": _principled,
}


def emission(node: Node, reader: Reader, what: str) -> np.ndarray:
    """Radiance of an area light, float32 [band]."""
    value = node.values.get("radiance", Colour(rgb=(1.0, 1.0, 1.0)))
    if node.part("radiance") is not None:
        raise NotCarried(f"{what}: a light with a picture or a spectrum of Mitsuba's own")
    colour = value if isinstance(value, Colour) else Colour(rgb=(float(value),) * 3)
    return spectrum(colour, reader, True, what).astype(np.float32)
