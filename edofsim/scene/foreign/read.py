"""A Mitsuba scene file as plain nodes, from XML or from JSON (the dictionary of `load_dict`).

Nothing is run and nothing is loaded here; names of files stay names.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from ...core.json_values import Json
from ...errors import InputError
from .nodes import Colour, Node, Values, all_nodes, check_size, rgb, snake, spectrum_of, square
from .xml import read_xml

KINDS = {
    "bsdf": """diffuse plastic roughplastic conductor roughconductor dielectric thindielectric roughdielectric
        principled principledthin twosided mask bumpmap normalmap blendbsdf null pplastic measured
        measured_polarized hair polarizer retarder circular""",
    "emitter": """area constant envmap point spot directional directionalarea projector sunsky timed_sunsky
        sky sun""",
    "shape": """obj ply rectangle cube sphere disk cylinder serialized instance shapegroup merge blender
        bsplinecurve linearcurve sdfgrid ellipsoids ellipsoidsmesh""",
    "texture": "bitmap checkerboard mesh_attribute volume",
    "sensor": "perspective thinlens orthographic batch distant radiancemeter irradiancemeter",
    "integrator": "path direct volpath volpathmis aov depth moment ptracer stokes",
    "scene": "scene",
}
"""Types of Mitsuba's plugins by their kinds, which dictionaries do not tell."""
TRANSFORMS = "to_world", "to_uv"
KIND_OF = {kind_of: kind for kind, names in KINDS.items() for kind_of in names.split()}


def read_nodes(path: Path, allow_outside: bool = False) -> Node:
    """The scene's root.

    path: an XML file, or a JSON file with the dictionary of `load_dict`.
    allow_outside: whether it may include files from outside its folder.

    Raises InputError for a file that is missing, too large, malformed, or no scene.
    """
    check_size(path)
    if path.suffix.lower() not in (".xml", ".json"):
        raise InputError(f"{path}: a Mitsuba scene is an .xml file or a .json file with a dictionary")
    try:
        root = read_xml(path, allow_outside) if path.suffix.lower() == ".xml" else _read_json(path)
    except RecursionError:
        raise InputError(f"{path}: nested too deeply") from None
    if root.type != "scene":
        raise InputError(f"{path}: its outermost element is {root.type!r}, not a scene")
    all_nodes(root)
    return root


def _read_json(path: Path) -> Node:
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: not valid JSON: {error}") from None
    if not isinstance(data, dict):
        raise InputError(f"{path}: holds no dictionary")
    return _Dictionary(data, path).node(data, "scene")


class _Dictionary:
    """Turns dictionaries into nodes. What has a name may stand after what refers to it, as in XML."""

    def __init__(self, data: Json, path: Path) -> None:
        self.path = path
        self.named: dict[str, Json] = {}
        self.known: dict[str, Node | None] = {}  # None: on the way
        self._collect(data)

    def _collect(self, data: Json) -> None:
        for key, value in data.items():
            if isinstance(value, dict):
                if value.get("type") != "ref":
                    self.named.setdefault(str(value.get("id", key)), value)
                self._collect(value)

    def node(self, data: Json, name: str) -> Node:
        kind_of = data.get("type")
        if not isinstance(kind_of, str):
            raise InputError(f"{self.path}: {name!r} has no 'type'")
        values = Values()
        parts: list[tuple[str, Node]] = []
        for key, value in data.items():
            place = f"{self.path}: {name}.{key}"
            if key in ("type", "id"):
                continue
            if isinstance(value, dict) and value.get("type") in ("rgb", "spectrum"):
                values[snake(key)] = _json_colour(value, place)
            elif isinstance(value, dict) and value.get("type") == "ref":
                parts.append((snake(key), self.referred(str(value.get("id")), place)))
            elif isinstance(value, dict):
                identity = str(value.get("id", key))
                own = self.named.get(identity) is value
                parts.append((snake(key), self.referred(identity, place) if own else self.node(value, key)))
            elif isinstance(value, list):
                flat = _flat(value, place)
                matrix = len(flat) in (9, 16) or snake(key) in TRANSFORMS
                values[snake(key)] = square(flat, place) if matrix else np.array(flat)
            elif snake(key) in TRANSFORMS:
                raise InputError(f"{place}: {value!r} is no matrix; give 4 x 4 numbers")
            else:
                if value is None or (isinstance(value, str) and "\0" in value):
                    raise InputError(f"{place}: {value!r} is not understood")
                if not isinstance(value, str):
                    _flat(value, place)
                values[snake(key)] = value
        return Node(KIND_OF.get(kind_of, ""), kind_of, values, tuple(parts))

    def referred(self, identity: str, place: str) -> Node:
        if identity not in self.named:
            raise InputError(f"{place}: names {identity!r}, which the scene does not define")
        if identity in self.known:
            node = self.known[identity]
            if node is None:
                raise InputError(f"{place}: {identity!r} refers to itself")
            return node
        self.known[identity] = None
        node = self.known[identity] = self.node(self.named[identity], identity)
        return node


def _flat(value: object, where: str) -> list[float]:
    """The numbers of lists in lists."""
    try:
        numbers = [float(v) for v in np.asarray(value, float).ravel()]
    except (ValueError, TypeError, OverflowError):
        raise InputError(f"{where}: {str(value)[:60]!r} holds something that is no number") from None
    if not np.isfinite(numbers).all():
        raise InputError(f"{where}: holds a number that is not finite")
    return numbers


def _json_colour(value: Json, where: str) -> Colour:
    if value["type"] == "rgb":
        written = value.get("value", [])
        return rgb(written if isinstance(written, str) else " ".join(map(repr, _flat(written, where))), where)
    if "wavelengths" in value:
        nm, values = (_flat(value.get(key, []), f"{where}.{key}") for key in ("wavelengths", "value"))
        if len(nm) != len(values) or not nm:
            raise InputError(f"{where}: {len(nm)} wavelengths and {len(values)} values")
        return Colour(samples=tuple(sorted(zip(nm, values, strict=True))))
    return spectrum_of(str(value.get("value", "")), where)
