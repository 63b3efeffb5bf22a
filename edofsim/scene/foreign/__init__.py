"""Scenes in Mitsuba's own format, read into a SceneModel as far as many bands can share one path.

The scene is seen from its sensor's place, in the field of the recipe's frame. What cannot be carried is
named, every part of it: `NotCarried`.
"""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Literal

import numpy as np

from ...errors import InputError
from ...recipe.base import Positive
from .. import solids, spectra
from ..model import BandTexture, Environment, SceneModel, SceneObject
from ..pictures import read_hdr
from ..reader import SceneReader
from ..surfaces import matt
from ..textures import flat
from .nodes import Colour, Node
from .parts import NotCarried, Reader, emission, shape_mesh, spectrum, surface
from .read import read_nodes

LOG = logging.getLogger(__name__)
LONGEST = 64
"""Segments of a path; `render.max_depth` allows no more."""
PINHOLES = ("perspective", "thinlens")
PATHS = ("path", "volpath", "volpathmis")


class MitsubaSource(SceneReader):
    """A Mitsuba scene: an XML file, or a JSON file with the dictionary of `load_dict`.

    It is seen from its own sensor's place; `units_m` is the length of its unit in metres. Files outside
    the scene's folder are refused unless `allow_outside`."""

    kind: Literal["mitsuba"]
    path: str
    """scene file of Mitsuba (XML or JSON), relative to the recipe's folder"""
    units_m: Positive = 1.0
    """length of the file's unit, m"""
    allow_outside: bool = False
    """whether the scene may name files outside its folder"""
    illuminant: str = "D65"
    """spectrum of lights that are given as RGB white"""

    def scene(self, base: Path, wavelengths: np.ndarray, name: str) -> SceneModel:
        return read_scene(self, base, wavelengths, name)


def read_scene(source: MitsubaSource, base: Path, wavelengths: np.ndarray, name: str) -> SceneModel:
    """A Mitsuba scene as a SceneModel in camera space.

    wavelengths: [band] m.

    Raises InputError for files that are missing, damaged, or outside the scene's folder, and NotCarried for
    surfaces, lights and shapes that only Mitsuba itself can render.
    """
    path = Path(base) / source.path
    root = read_nodes(path, source.allow_outside)
    white = spectra.illuminant(source.illuminant, wavelengths)
    reader = Reader(path.parent, source.allow_outside, wavelengths, white)
    to_camera = _to_camera(root, source.units_m)
    problems: list[str] = []
    too_much: list[str] = []
    objects: list[SceneObject] = []
    for number, shape in enumerate(root.of_kind("shape"), start=1):
        what = f"{path.name}, shape {number} ({shape.type})"
        try:
            objects.append(_object(shape, reader, to_camera, what))
            too_much += [f"{what}: {each} is Mitsuba's own" for each in dict.fromkeys(shape.unread())]
        except NotCarried as error:
            too_much += error.problems
        except InputError as error:
            problems += error.problems
    environment = None
    for number, light in enumerate(root.of_kind("emitter")):
        what = f"{path.name}, light ({light.type})"
        try:
            if number > 0:
                raise NotCarried(f"{what}: more than one light without a shape")
            environment = _environment(light, reader, to_camera, what)
            too_much += [f"{what}: {each} is Mitsuba's own" for each in dict.fromkeys(light.unread())]
        except NotCarried as error:
            too_much += error.problems
        except InputError as error:
            problems += error.problems
    odd = dict.fromkeys(part.type for _, part in root.parts if not part.kind)
    too_much += [f"{path.name}: {kind!r} is Mitsuba's own" for kind in odd]
    length, reasons = path_length(root)
    too_much += [f"{path.name}: {reason}" for reason in reasons]
    if problems:
        raise InputError(problems)
    if too_much:
        raise NotCarried(too_much)
    if not objects:
        raise InputError(f"{path}: the scene has no shapes")
    about = {"read from": str(source.path)}
    return SceneModel(name, wavelengths, tuple(objects), environment, about, path_length=length)


def path_length(root: Node) -> tuple[int, list[str]]:
    """The longest path that a scene asks for, as `render.max_depth` counts, and what of its integrator only
    Mitsuba itself does. Without an integrator, and where it says -1, Mitsuba's paths have no limit; here it
    is `LONGEST`, which roulette leaves next to no light beyond."""
    found = root.of_kind("integrator")
    if not found:
        return LONGEST, []
    integrator = found[0]
    length = int(integrator.values.get("max_depth", -1))
    length = LONGEST if length < 0 else min(max(length, 1), LONGEST)
    if integrator.type == "direct":
        return 2, []
    if integrator.type not in PATHS:
        return LONGEST, []
    return length, [f"{each} is Mitsuba's own" for each in integrator.unread()]


def _object(shape: Node, reader: Reader, to_camera: np.ndarray, what: str) -> SceneObject:
    mesh = solids.moved(shape_mesh(shape, reader, what), to_camera[:3, :3], to_camera[:3, 3])
    if shape.values.get("flip_normals", False):
        mesh = solids.inside_out(mesh)
    lights = shape.of_kind("emitter")
    surfaces = shape.of_kind("bsdf")
    if len(lights) > 1 or len(surfaces) > 1:
        raise NotCarried(f"{what}: more than one light or surface")
    bare = matt(
        flat(0.0 if lights else 0.5, reader.wavelengths)
    )  # Mitsuba's lamps reflect nothing by default
    skin = surface(surfaces[0], reader, what) if surfaces else bare
    if skin.reflectance.image is not None and mesh.uv is None:
        raise NotCarried(f"{what}: a texture on a shape whose texture coordinates are Mitsuba's own")
    return SceneObject(what, mesh, skin, emission(lights[0], reader, what) if lights else None)


def _to_camera(root: Node, units_m: float) -> np.ndarray:
    """World to camera space in metres, float64 [4, 4]."""
    sensors = root.of_kind("sensor")
    pose = np.asarray(sensors[0].values.get("to_world", np.eye(4))) if sensors else np.eye(4)
    if abs(np.linalg.det(pose[:3, :3])) < 1e-12:
        raise InputError("the sensor's to_world cannot be inverted")
    sensor = sensors[0].type if sensors else PINHOLES[0]
    if sensor not in PINHOLES:
        LOG.warning("a sensor of type %r is taken as a pinhole at its place: near things look larger", sensor)
    return camera_space(pose, sensor, units_m)


def camera_space(pose: np.ndarray, sensor: str, units_m: float) -> np.ndarray:
    """World to camera space in metres, float64 [4, 4], of a sensor of that type. Mitsuba's has x to the left:
    it is mirrored. One that is no pinhole or thin lens is seen as a pinhole at its place.

    pose: [4, 4], world to camera.
    """
    if sensor not in PINHOLES:
        pose = pose.copy()  # its scale is how much it sees
        pose[:3, :3] /= np.linalg.norm(pose[:3, :3], axis=0)
    return np.diag([-units_m, units_m, units_m, 1.0]) @ np.linalg.inv(pose)


def _environment(light: Node, reader: Reader, to_camera: np.ndarray, what: str) -> Environment:
    if light.type == "constant":
        value = light.values.get("radiance", Colour(rgb=(1.0, 1.0, 1.0)))
        colour = value if isinstance(value, Colour) else Colour(rgb=(float(value),) * 3)
        return Environment(BandTexture(spectrum(colour, reader, True, what)[None].astype(np.float32)))
    if light.type == "envmap":
        if reader.file(light, what).suffix.lower() not in (".exr", ".hdr", ".pfm"):
            raise NotCarried(f"{what}: a picture of 8 or 16 bits as surroundings")
        image = np.clip(read_hdr(reader.file(light, what), what), 0, None)
        pose = np.asarray(light.values.get("to_world", np.eye(4)))
        turned = _resampled(image, to_camera[:3, :3] @ pose[:3, :3])
        basis = float(light.values.get("scale", 1.0)) * reader.white * spectra.srgb_basis(reader.wavelengths)
        return Environment(BandTexture(basis.astype(np.float32), turned))
    raise NotCarried(f"{what}: lights of type {light.type!r} are Mitsuba's own")


def _resampled(image: np.ndarray, to_camera: np.ndarray) -> np.ndarray:
    """An equirectangular picture in camera space, by bilinear interpolation, float32 [y, x, 3].

    Mitsuba's map has +y on top; its column u looks along (sin 2 pi u, ., -cos 2 pi u). Ours: see
    `Environment`.
    """
    from scipy.ndimage import map_coordinates

    rows, columns = image.shape[:2]
    elevation = np.pi * (0.5 - (np.arange(rows) + 0.5) / rows)[:, None]
    azimuth = 2 * np.pi * ((np.arange(columns) + 0.5) / columns - 0.5)[None]
    ours = np.stack(
        np.broadcast_arrays(
            np.cos(elevation) * np.sin(azimuth), np.sin(elevation), np.cos(elevation) * np.cos(azimuth)
        ),
        axis=-1,
    )
    theirs = ours @ np.linalg.inv(to_camera).T
    theirs /= np.linalg.norm(theirs, axis=-1, keepdims=True)
    u = np.arctan2(theirs[..., 0], -theirs[..., 2]) / (2 * np.pi) % 1.0
    v = np.arccos(np.clip(theirs[..., 1], -1, 1)) / np.pi
    wrapped = np.concatenate([image[:, -1:], image, image[:, :1]], axis=1)
    at = [np.clip(v * rows - 0.5, 0, rows - 1), u * columns + 0.5]
    channels = [map_coordinates(wrapped[..., c], at, order=1, mode="nearest") for c in range(3)]
    return np.stack(channels, axis=-1).astype(np.float32)


__all__ = ["NotCarried", "read_scene"]
