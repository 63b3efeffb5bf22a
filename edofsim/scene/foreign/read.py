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

BSDFS = ("diffuse", "plastic", "roughplastic", "conductor", "roughconductor", "dielectric", "thindielectric",
         "principled", "twosided", "roughdielectric", "mask", "bumpmap", "normalmap", "blendbsdf", "null",
         "pplastic", "measured")  # fmt: skip
EMITTERS = ("area", "constant", "envmap", "point", "spot", "directional", "projector", "sunsky", "sky", "sun")
SHAPES = ("obj", "ply", "rectangle", "cube", "sphere", "disk", "cylinder", "serialized", "instance",
          "shapegroup", "bsplinecurve", "linearcurve", "sdfgrid", "ellipsoids")  # fmt: skip
TEXTURES = ("bitmap", "checkerboard", "mesh_attribute", "volume")


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
    known: dict[str, Node] = {}
    return _json_node(data, "scene", str(path), known)


def _json_node(data: Json, name: str, where: str, known: dict[str, Node]) -> Node:
    kind_of = data.get("type")
    if not isinstance(kind_of, str):
        raise InputError(f"{where}: {name!r} has no 'type'")
    values = Values()
    parts: list[tuple[str, Node]] = []
    for key, value in data.items():
        place = f"{where}: {name}.{key}"
        if key in ("type", "id"):
            continue
        if isinstance(value, dict) and value.get("type") in ("rgb", "spectrum"):
            values[snake(key)] = _json_colour(value, place)
        elif isinstance(value, dict) and value.get("type") == "ref":
            identity = str(value.get("id"))
            if identity not in known:
                raise InputError(f"{place}: the reference {identity!r} is not defined before it")
            parts.append((snake(key), known[identity]))
        elif isinstance(value, dict):
            node = _json_node(value, key, where, known)
            known[str(value.get("id", key))] = node
            parts.append((snake(key), node))
        elif isinstance(value, list):
            flat = _flat(value, place)
            values[snake(key)] = square(flat, place) if len(flat) in (9, 16) else np.array(flat)
        else:
            if value is None or (isinstance(value, str) and "\0" in value):
                raise InputError(f"{place}: {value!r} is not understood")
            if not isinstance(value, str):
                _flat(value, place)
            values[snake(key)] = value
    return Node(_kind(kind_of), kind_of, values, tuple(parts))


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


def _kind(kind_of: str) -> str:
    """JSON tells plugins apart by their types alone."""
    tables = {"bsdf": BSDFS, "emitter": EMITTERS, "shape": SHAPES, "texture": TEXTURES}
    for kind, names in tables.items():
        if kind_of in names:
            return kind
    return {"perspective": "sensor", "thinlens": "sensor", "scene": "scene"}.get(kind_of, "")
