"""A Mitsuba scene's XML as plain nodes: defaults, references, aliases, includes and folders filled in.

Mitsuba's own parser (`mitsuba.parser`) needs a working engine and opens any file that a scene names. This one
needs none, and opens a file only where the recipe allows it. What it does not know becomes a part that nobody
reads, so that the scene goes to Mitsuba (see `Node.unread`).
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ...errors import InputError
from .nodes import (
    MAX_BYTES,
    MOST_FILES,
    PLUGINS,
    Colour,
    Node,
    Values,
    check_size,
    look_at,
    numbers_of,
    rgb,
    rotation_about,
    snake,
    spectrum_of,
    square,
)

_NAMED = {"name", "value", "id"}
_ATTRIBUTES = {
    "point": {"x", "y", "z"}, "vector": {"x", "y", "z"}, "spectrum": {"filename"}, "ref": set[str](),
}  # fmt: skip
_OF_STEPS = {"x", "y", "z", "value", "angle", "origin", "target", "up"}


def read_xml(path: Path, allow_outside: bool) -> Node:
    """The scene in an XML file. Raises InputError for what is malformed, and for files outside its folder."""
    reader = _Xml(path, allow_outside)
    root = reader.parsed(path)
    return reader.plugin(root, "scene") if root.tag == "scene" else Node("", root.tag)


def parameters(path: Path, allow_outside: bool) -> dict[str, str]:
    """The defaults that a scene's files use by $NAME, by name: Mitsuba refuses those that stand after that.

    Raises what `read_xml` raises."""
    reader = _Xml(path, allow_outside)
    reader.parsed(path)
    used: dict[str, str] = {}
    for name in sorted(reader.defaults, key=len, reverse=True):  # $size_long is no use of $size
        if any(f"${name}" in word for word in reader.words):
            used[name] = reader.defaults[name]
            reader.words = [word.replace(f"${name}", "") for word in reader.words]
    return used


class _Xml:
    """Turns elements into nodes. All files are gone through for defaults and names first, as both may stand
    after what uses them."""

    def __init__(self, path: Path, allow_outside: bool) -> None:
        self.path, self.allow_outside = path, allow_outside
        self.defaults: dict[str, str] = {}
        self.elements: dict[str, ET.Element] = {}
        self.known: dict[str, Node | None] = {}  # None: on the way
        self.included: dict[ET.Element, ET.Element] = {}
        self.opened = 0
        self.folders = [path.parent]
        self.words: list[str] = []

    def parsed(self, path: Path) -> ET.Element:
        """A file and those that it includes, with the names that they define."""
        check_size(path)
        self.opened += 1
        if self.opened > MOST_FILES:
            raise InputError(f"{self.path}: includes more than {MOST_FILES} files, or itself")
        try:
            root = ET.parse(path).getroot()
        except (ET.ParseError, LookupError, ValueError) as error:  # the latter two: encodings
            raise InputError(f"{path}: not valid XML: {error}") from None
        for element in root.iter():
            self.words += [word for word in element.attrib.values() if "$" in word]
            if element.tag == "default":
                self.defaults.setdefault(self.text(element, "name"), self.text(element, "value"))
            elif element.tag == "path":
                self.folders.append(self.file(self.text(element, "value")))
            elif element.tag == "include":
                inner = self.parsed(self.file(self.text(element, "filename")))
                self.included[element] = inner
            if "id" in element.attrib and element.tag not in ("ref", "alias"):
                self.elements.setdefault(self.text(element, "id"), element)
        for element in root.iter("alias"):
            identity = self.text(element, "id")
            if identity not in self.elements:
                raise InputError(f"{self.path}: an alias names {identity!r}, which the scene does not define")
            self.elements[self.text(element, "as")] = self.elements[identity]
        return root

    def file(self, name: str) -> Path:
        """A file or folder that the scene names, where it is found; in the scene's folder where nowhere."""
        try:
            found = next((f / name for f in reversed(self.folders) if (f / name).exists()), None)
        except OSError as error:
            raise InputError(f"{self.path} names {name[:60]!r}: {error.strerror}") from None
        path = self.path.parent / name if found is None else found
        inside = path.resolve().is_relative_to(self.path.parent.resolve())
        if not inside and not self.allow_outside:
            raise InputError(
                f"{self.path} names {name!r}, a file outside the scene's folder; set allow_outside = true in "
                "[source] if you trust the scene"
            )
        return path

    def children(self, element: ET.Element) -> Iterator[ET.Element]:
        for child in element:
            if child.tag == "include":
                inner = self.included[child]
                yield from self.children(inner) if inner.tag == "scene" else [inner]
            elif child.tag not in ("default", "path", "alias"):
                yield child

    def plugin(self, element: ET.Element, kind: str) -> Node:
        values = Values()
        parts: list[tuple[str, Node]] = []
        for number, child in enumerate(self.children(element)):
            name = snake(self.text(child, "name", f"unnamed-{number}"))
            if child.tag == "ref":
                parts.append((name, self.referred(self.text(child, "id"))))
            elif child.tag in PLUGINS or "type" in child.attrib:
                parts.append((name, self.identified(child)))
            elif child.tag in _VALUES:
                values[name] = self.value(child)
                own = _NAMED | _ATTRIBUTES.get(child.tag, set())
                values.update({f"{name}.{key}": child.attrib[key] for key in child.attrib if key not in own})
            else:
                parts.append((name, Node("", child.tag)))
        type_ = "scene" if kind == "scene" else self.text(element, "type", kind)
        return Node(kind, type_, values, tuple(parts))

    def identified(self, element: ET.Element) -> Node:
        """The node of an element; one that has a name is the same for all that refer to it."""
        if "id" not in element.attrib:
            return self.plugin(element, element.tag)
        identity = self.text(element, "id")
        return (
            self.referred(identity)
            if self.elements[identity] is element
            else self.plugin(element, element.tag)
        )

    def referred(self, identity: str) -> Node:
        if identity not in self.elements:
            raise InputError(f"{self.path}: a ref names {identity!r}, which the scene does not define")
        if identity in self.known:
            node = self.known[identity]
            if node is None:
                raise InputError(f"{self.path}: {identity!r} refers to itself")
            return node
        self.known[identity] = None
        element = self.elements[identity]
        node = self.known[identity] = self.plugin(element, element.tag)
        return node

    def text(self, element: ET.Element, attribute: str, otherwise: str | None = None) -> str:
        text = element.attrib.get(attribute, otherwise)
        if text is None:
            raise InputError(f"{self.path}: <{element.tag}> does not have {attribute!r}")
        for name in sorted(self.defaults, key=len, reverse=True):
            if text.count(f"${name}") * len(self.defaults[name]) > MAX_BYTES:
                raise InputError(f"{self.path}: ${name} makes a text of more than {MAX_BYTES >> 20} MiB")
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
                numbers = numbers_of(text, where)
                if len(numbers) != 1:
                    raise InputError(f"{where}: needs one number, not {text!r}")
                return numbers[0]
            case "boolean":
                return text.strip().lower() == "true"
            case "rgb":
                return rgb(text, where)
            case "spectrum":
                return self.spectrum(element, text, where)
        is_file = element.attrib.get("name", "").endswith("filename") and text
        return str(self.file(text).resolve()) if is_file and len(self.folders) > 1 else text

    def spectrum(self, element: ET.Element, text: str, where: str) -> Colour:
        """Written down, or in a file of wavelengths and values, a pair a line, # before a remark."""
        if "filename" not in element.attrib:
            return spectrum_of(text, where)
        path = self.file(self.text(element, "filename"))
        check_size(path)
        lines = [
            line.split("#")[0] for line in path.read_text(encoding="utf-8", errors="replace").splitlines()
        ]
        pairs = [numbers_of(line, f"{path}") for line in lines if line.strip()]
        if not pairs or any(len(pair) != 2 for pair in pairs):
            raise InputError(f"{path}: a spectrum's file has a wavelength in nm and a value on each line")
        return Colour(samples=tuple(sorted((a, b) for a, b in pairs)))

    def xyz(self, element: ET.Element, where: str, otherwise: float) -> list[float]:
        if "value" in element.attrib:
            numbers = numbers_of(self.text(element, "value"), where)
            numbers = numbers * 3 if len(numbers) == 1 else numbers
        else:
            numbers = [numbers_of(self.text(element, a, str(otherwise)), where)[0] for a in "xyz"]
        if len(numbers) != 3:
            raise InputError(f"{where}: needs three numbers")
        return numbers

    def transform(self, element: ET.Element, where: str) -> np.ndarray:
        matrix = np.eye(4)
        for step in element:
            if unknown := set(step.attrib) - _OF_STEPS:
                raise InputError(f"{where}: <{step.tag}> has {sorted(unknown)[0]!r}, which is not understood")
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
                angle = np.radians(numbers_of(self.text(step, "angle"), where)[0])
                matrix[:3, :3] = rotation_about(axis, angle, where)
            case "lookat" | "lookAt" | "look_at":
                origin, target, up = (
                    np.array(numbers_of(self.text(step, a, "0,1,0"), where))
                    for a in ("origin", "target", "up")
                )
                if not origin.size == target.size == up.size == 3:
                    raise InputError(f"{where}: look_at needs three numbers for origin, target and up each")
                matrix = look_at(origin, target, up, where)
            case "matrix":
                matrix = square(numbers_of(self.text(step, "value"), where), where)
            case _:
                raise InputError(f"{where}: the step <{step.tag}> is not understood")
        return matrix


_VALUES = ("transform", "point", "vector", "float", "integer", "boolean", "string", "rgb", "spectrum")
