"""A Mitsuba scene file as plain nodes, from XML or from JSON (the dictionary of `load_dict`).

Nothing is run and nothing is loaded here; names of files stay names.
"""

from __future__ import annotations

import json
import re
import xml.etree.ElementTree as ET
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from ...core.json_values import Json
from ...errors import InputError

PLUGINS = ("scene", "shape", "bsdf", "emitter", "sensor", "texture", "film", "sampler", "integrator",
           "rfilter", "medium", "phase", "volume")  # fmt: skip
BSDFS = ("diffuse", "plastic", "roughplastic", "conductor", "roughconductor", "dielectric", "thindielectric",
         "principled", "twosided", "roughdielectric", "mask", "bumpmap", "normalmap", "blendbsdf", "null",
         "pplastic", "measured")  # fmt: skip
EMITTERS = ("area", "constant", "envmap", "point", "spot", "directional", "projector", "sunsky", "sky", "sun")
SHAPES = ("obj", "ply", "rectangle", "cube", "sphere", "disk", "cylinder", "serialized", "instance",
          "shapegroup", "bsplinecurve", "linearcurve", "sdfgrid", "ellipsoids")  # fmt: skip
TEXTURES = ("bitmap", "checkerboard", "mesh_attribute", "volume")
MAX_BYTES = 1 << 26


@dataclass(frozen=True)
class Colour:
    """A colour or spectrum as it is written: linear RGB, one number, or pairs of nanometres and values."""

    rgb: tuple[float, float, float] | None = None
    value: float | None = None
    samples: tuple[tuple[float, float], ...] | None = None


# only the code that reads a plugin knows what each of its values is
Values: TypeAlias = dict[str, Any]  # pyrefly: ignore[explicit-any]


@dataclass(frozen=True)
class Node:
    """A plugin: its kind (`shape`, `bsdf`, ...; empty where JSON doesn't say), type, values and parts.

    values: numbers, strings, booleans, points (float [3]), transforms (float [4, 4]) and `Colour`s by name.
    """

    kind: str
    type: str
    values: Values = field(default_factory=dict)
    parts: tuple[tuple[str, Node], ...] = ()

    def part(self, name: str) -> Node | None:
        """The first part of that name."""
        return next((node for key, node in self.parts if key == name), None)

    def of_kind(self, kind: str) -> list[Node]:
        """All parts of a kind."""
        return [node for _, node in self.parts if node.kind == kind]


def read_nodes(path: Path) -> Node:
    """The scene's root. Raises InputError for a file that is missing, too large, malformed, or no scene."""
    if not path.is_file():
        raise InputError(f"the Mitsuba scene {str(path)!r} does not exist")
    if path.stat().st_size > MAX_BYTES:
        raise InputError(f"{path}: larger than {MAX_BYTES >> 20} MiB; keep meshes in files of their own")
    readers = {".xml": _read_xml, ".json": _read_json}
    if path.suffix.lower() not in readers:
        raise InputError(f"{path}: a Mitsuba scene is an .xml file or a .json file with a dictionary")
    try:
        root = readers[path.suffix.lower()](path)
    except RecursionError:
        raise InputError(f"{path}: nested too deeply") from None
    if root.type != "scene":
        raise InputError(f"{path}: its outermost element is {root.type!r}, not a scene")
    return root


def _snake(name: str) -> str:
    """Older files write toWorld for to_world."""
    return re.sub(r"(?<=[a-z0-9])([A-Z])", lambda m: "_" + m[1].lower(), name)


def _numbers(text: str, where: str) -> list[float]:
    try:
        numbers = [float(part) for part in re.split(r"[\s,]+", text.strip()) if part]
    except ValueError:
        raise InputError(f"{where}: {text[:60]!r} holds something that is no number") from None
    if not np.isfinite(numbers).all():
        raise InputError(f"{where}: {text[:60]!r} holds a number that is not finite")
    return numbers


# ---- XML ---------------------------------------------------------------------------------------------


def _read_xml(path: Path) -> Node:
    try:
        root = ET.parse(path).getroot()
    except ET.ParseError as error:
        raise InputError(f"{path}: not valid XML: {error}") from None
    reader = _Xml(path)
    if root.tag != "scene":
        return Node("", root.tag)
    return reader.plugin(root, "scene")


class _Xml:
    """Turns elements into nodes, with the file's own defaults and references filled in."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.defaults: dict[str, str] = {}
        self.known: dict[str, Node] = {}

    def plugin(self, element: ET.Element, kind: str) -> Node:
        values: Values = {}
        parts: list[tuple[str, Node]] = []
        for number, child in enumerate(element):
            name = _snake(self.text(child, "name", f"unnamed-{number}"))
            if child.tag == "default":
                self.defaults.setdefault(self.text(child, "name"), self.text(child, "value"))
            elif child.tag == "ref":
                identity = self.text(child, "id")
                if identity not in self.known:
                    raise InputError(f"{self.path}: a ref names {identity!r}, which is not defined before it")
                parts.append((name, self.known[identity]))
            elif child.tag in PLUGINS:
                node = self.plugin(child, child.tag)
                if "id" in child.attrib:
                    self.known[self.text(child, "id")] = node
                parts.append((name, node))
            else:
                values[name] = self.value(child)
        return Node(
            kind, self.text(element, "type", "scene") if kind != "scene" else "scene", values, tuple(parts)
        )

    def text(self, element: ET.Element, attribute: str, otherwise: str | None = None) -> str:
        text = element.attrib.get(attribute, otherwise)
        if text is None:
            raise InputError(f"{self.path}: <{element.tag}> lacks {attribute!r}")
        for name in sorted(self.defaults, key=len, reverse=True):
            text = text.replace(f"${name}", self.defaults[name])
        return text

    def value(self, element: ET.Element) -> Colour | np.ndarray | float | str:
        where = f"{self.path}: <{element.tag} name={element.attrib.get('name')!r}>"
        if element.tag == "transform":
            return self.transform(element, where)
        if element.tag in ("point", "vector"):
            return np.array(self.xyz(element, where, 0.0))
        text = self.text(element, "value", "")
        match element.tag:
            case "float" | "integer":
                numbers = _numbers(text, where)
                if len(numbers) != 1:
                    raise InputError(f"{where}: needs one number, not {text!r}")
                return numbers[0]
            case "boolean":
                return text.strip().lower() == "true"
            case "string":
                return text
            case "rgb":
                return _rgb(text, where)
            case "spectrum":
                return _spectrum(text, where)
        raise InputError(f"{self.path}: <{element.tag}> is not understood here")

    def xyz(self, element: ET.Element, where: str, otherwise: float) -> list[float]:
        if "value" in element.attrib:
            numbers = _numbers(self.text(element, "value"), where)
            numbers = numbers * 3 if len(numbers) == 1 else numbers
        else:
            numbers = [_numbers(self.text(element, a, str(otherwise)), where)[0] for a in "xyz"]
        if len(numbers) != 3:
            raise InputError(f"{where}: needs three numbers")
        return numbers

    def transform(self, element: ET.Element, where: str) -> np.ndarray:
        matrix = np.eye(4)
        for step in element:
            matrix = self.step(step, where) @ matrix
        return matrix

    def step(self, step: ET.Element, where: str) -> np.ndarray:
        matrix = np.eye(4)
        match step.tag:
            case "translate":
                matrix[:3, 3] = self.xyz(step, where, 0.0)
            case "scale":
                matrix[:3, :3] = np.diag(self.xyz(step, where, 1.0))
            case "rotate":
                axis = np.array(self.xyz(step, where, 0.0))
                angle = np.radians(_numbers(self.text(step, "angle"), where)[0])
                matrix[:3, :3] = rotation_about(axis, angle, where)
            case "lookat" | "lookAt" | "look_at":
                origin, target, up = (
                    np.array(_numbers(self.text(step, a, "0,1,0"), where)) for a in ("origin", "target", "up")
                )
                matrix = look_at(origin, target, up, where)
            case "matrix":
                matrix = square(_numbers(self.text(step, "value"), where), where)
            case _:
                raise InputError(f"{where}: the step <{step.tag}> is not understood")
        return matrix


def rotation_about(axis: np.ndarray, angle: float, where: str) -> np.ndarray:
    """Rotation by `angle` (radians) about `axis`, float64 [3, 3] (Rodrigues)."""
    length = np.linalg.norm(axis)
    if length == 0:
        raise InputError(f"{where}: a rotation needs an axis")
    x, y, z = axis / length
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def look_at(origin: np.ndarray, target: np.ndarray, up: np.ndarray, where: str) -> np.ndarray:
    """Mitsuba's frame of a sensor: columns left, up, forward and the origin, float64 [4, 4]."""
    forward = target - origin
    left = np.cross(up, forward)
    if not (np.linalg.norm(forward) > 0 and np.linalg.norm(left) > 0):
        raise InputError(
            f"{where}: look_at needs a target away from its origin, and another upward direction"
        )
    forward, left = forward / np.linalg.norm(forward), left / np.linalg.norm(left)
    matrix = np.eye(4)
    matrix[:3] = np.stack([left, np.cross(forward, left), forward, origin], axis=1)
    return matrix


def square(numbers: list[float], where: str) -> np.ndarray:
    """A 4 x 4 (or 3 x 3) matrix from its numbers, row by row."""
    if len(numbers) not in (9, 16):
        raise InputError(f"{where}: a matrix needs 16 numbers, not {len(numbers)}")
    side = 3 if len(numbers) == 9 else 4
    matrix = np.eye(4)
    matrix[:side, :side] = np.reshape(numbers, (side, side))
    return matrix


def _rgb(text: str, where: str) -> Colour:
    if text.strip().startswith("#"):
        from ..spectra import hex_to_linear

        r, g, b = hex_to_linear(text.strip()).tolist()
        return Colour(rgb=(r, g, b))
    numbers = _numbers(text, where)
    numbers = numbers * 3 if len(numbers) == 1 else numbers
    if len(numbers) != 3:
        raise InputError(f"{where}: a colour needs three numbers, not {len(numbers)}")
    return Colour(rgb=(numbers[0], numbers[1], numbers[2]))


def _spectrum(text: str, where: str) -> Colour:
    if ":" not in text:
        numbers = _numbers(text, where)
        if len(numbers) == 1:
            return Colour(value=numbers[0])
        raise InputError(f"{where}: a spectrum is one number, or pairs like 400:0.1, 500:0.2")
    pairs = [_numbers(pair.replace(":", " "), where) for pair in re.split(r"[\s,]+", text.strip()) if pair]
    if any(len(pair) != 2 for pair in pairs):
        raise InputError(f"{where}: a spectrum is one number, or pairs like 400:0.1, 500:0.2")
    return Colour(samples=tuple(sorted((a, b) for a, b in pairs)))


# ---- JSON --------------------------------------------------------------------------------------------


def _read_json(path: Path) -> Node:
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: not valid JSON: {error}") from None
    if not isinstance(data, dict):
        raise InputError(f"{path}: holds no dictionary")
    known: dict[str, Node] = {}
    return _json_node(data, "scene", str(path), known)


def _json_node(data: Json, name: str, where: str, known: dict[str, Node]) -> Node:
    kind_of = data.get("type")
    if not isinstance(kind_of, str):
        raise InputError(f"{where}: {name!r} has no 'type'")
    values: Values = {}
    parts: list[tuple[str, Node]] = []
    for key, value in data.items():
        place = f"{where}: {name}.{key}"
        if key in ("type", "id"):
            continue
        if isinstance(value, dict) and value.get("type") in ("rgb", "spectrum"):
            values[_snake(key)] = _json_colour(value, place)
        elif isinstance(value, dict) and value.get("type") == "ref":
            identity = str(value.get("id"))
            if identity not in known:
                raise InputError(f"{place}: the reference {identity!r} is not defined before it")
            parts.append((_snake(key), known[identity]))
        elif isinstance(value, dict):
            node = _json_node(value, key, where, known)
            known[str(value.get("id", key))] = node
            parts.append((_snake(key), node))
        elif isinstance(value, list):
            flat = [float(v) for v in np.asarray(value, float).ravel()]
            values[_snake(key)] = square(flat, place) if len(flat) in (9, 16) else np.array(flat)
        else:
            if isinstance(value, float) and not np.isfinite(value):
                raise InputError(f"{place}: {value} is not finite")
            values[_snake(key)] = value
    return Node(_kind(kind_of), kind_of, values, tuple(parts))


def _json_colour(value: Json, where: str) -> Colour:
    if value["type"] == "rgb":
        return _rgb(" ".join(map(str, np.ravel(value.get("value", [])))), where)
    if "wavelengths" in value:
        pairs = zip(np.ravel(value["wavelengths"]), np.ravel(value.get("value", [])), strict=True)
        return Colour(samples=tuple(sorted((float(a), float(b)) for a, b in pairs)))
    return _spectrum(str(value.get("value", "")), where)


def _kind(kind_of: str) -> str:
    """JSON tells plugins apart by their types alone."""
    tables = {"bsdf": BSDFS, "emitter": EMITTERS, "shape": SHAPES, "texture": TEXTURES}
    for kind, names in tables.items():
        if kind_of in names:
            return kind
    return {"perspective": "sensor", "thinlens": "sensor", "scene": "scene"}.get(kind_of, "")
