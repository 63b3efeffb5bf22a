"""What a Mitsuba scene file says, as plain nodes that remember what of them was read."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from ...errors import InputError
from ..spectra import hex_to_linear

PLUGINS = ("scene", "shape", "bsdf", "emitter", "sensor", "texture", "film", "sampler", "integrator",
           "rfilter", "medium", "phase", "volume")  # fmt: skip
MAX_BYTES = 1 << 26
DEEPEST = 100
"""How far plugins may be nested, by references as well."""
MOST_FILES = 64
"""That a scene may include."""
HARMLESS = {"sampling_weight", "rr_depth", "id"}
"""What changes the noise of a rendering alone."""


@dataclass(frozen=True)
class Colour:
    """A colour or spectrum as it is written: linear RGB, one number, or pairs of nanometres and values."""

    rgb: tuple[float, float, float] | None = None
    value: float | None = None
    samples: tuple[tuple[float, float], ...] | None = None


# only the code that reads a plugin knows what each of its values is
Table: TypeAlias = dict[str, Any]  # pyrefly: ignore[explicit-any]


class Values(Table):
    """What a plugin says by name; remembers which of it was read."""

    def __init__(self, table: Table | None = None) -> None:
        super().__init__(table or {})
        self.seen: set[str] = set()

    def get(self, key: str, default: Any = None) -> Any:  # pyrefly: ignore[explicit-any]
        self.seen.add(key)
        return super().get(key, default)

    def __getitem__(self, key: str) -> Any:  # pyrefly: ignore[explicit-any]
        self.seen.add(key)
        return super().__getitem__(key)


@dataclass(frozen=True)
class Node:
    """A plugin: its kind (`shape`, `bsdf`, ...; empty where JSON doesn't say), type, values and parts.

    values: numbers, strings, booleans, points (float [3]), transforms (float [4, 4]) and `Colour`s by name.
    """

    kind: str
    type: str
    values: Values = field(default_factory=Values)
    parts: tuple[tuple[str, Node], ...] = ()
    taken: set[int] = field(default_factory=set, compare=False, repr=False)
    """places of the parts that were read"""

    def part(self, name: str) -> Node | None:
        """The first part of that name."""
        return next(iter(self._take(lambda key, _: key == name)[:1]), None)

    def of_kind(self, kind: str) -> list[Node]:
        """All parts of a kind."""
        return self._take(lambda _, node: node.kind == kind)

    def _take(self, wanted: Callable[[str, Node], bool]) -> list[Node]:
        found = [place for place, (key, node) in enumerate(self.parts) if wanted(key, node)]
        self.taken.update(found)
        return [self.parts[place][1] for place in found]

    def unread(self) -> list[str]:
        """What nobody has asked this plugin, and those of its parts that were read, for: names of values, and
        types of parts."""
        found = [f"{self.type}'s {key}" for key in self.values if key not in self.values.seen | HARMLESS]
        for place, (key, node) in enumerate(self.parts):
            own = [f"{self.type}'s {node.type} ({key})"]
            found += node.unread() if place in self.taken else own
        return found


def all_nodes(root: Node) -> list[Node]:
    """Every plugin once, however many refer to it. Raises InputError where they are nested too deeply."""
    found: dict[int, Node] = {}
    level = {id(root): root}
    for _ in range(DEEPEST):
        found |= level
        level = {id(part): part for node in level.values() for _, part in node.parts}
        if not level:
            return list(found.values())
    raise InputError(f"plugins of the scene are nested more than {DEEPEST} deep")


def check_size(path: Path) -> None:
    """Raises InputError for a file that is not there, or too large."""
    if not path.is_file():
        raise InputError(f"the Mitsuba scene {str(path)!r} does not exist")
    if path.stat().st_size > MAX_BYTES:
        raise InputError(f"{path}: larger than {MAX_BYTES >> 20} MiB; keep meshes in files of their own")


def snake(name: str) -> str:
    """Older files write toWorld for to_world."""
    return re.sub(r"(?<=[a-z0-9])([A-Z])", lambda m: "_" + m[1].lower(), name)


def numbers_of(text: str, where: str) -> list[float]:
    """The numbers of an attribute. Raises InputError for anything else, naming `where`."""
    try:
        numbers = [float(part) for part in re.split(r"[\s,]+", text.strip()) if part]
    except ValueError:
        raise InputError(f"{where}: {text[:60]!r} holds something that is no number") from None
    if not np.isfinite(numbers).all():
        raise InputError(f"{where}: {text[:60]!r} holds a number that is not finite")
    return numbers


def rotation_about(axis: np.ndarray, angle: float, where: str) -> np.ndarray:
    """Rotation by `angle` (radians) about `axis`, float64 [3, 3] (Rodrigues). An axis that is not of length 1
    scales and shears, as it does in Mitsuba.

    axis: [3].

    Raises InputError for an axis of length 0.
    """
    if not np.linalg.norm(axis) > 0:
        raise InputError(f"{where}: a rotation needs an axis")
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.cos(angle) * np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * np.outer(axis, axis)


def look_at(origin: np.ndarray, target: np.ndarray, up: np.ndarray, where: str) -> np.ndarray:
    """Mitsuba's frame of a sensor: columns left, up, forward and the origin, float64 [4, 4].

    origin, target, up: [3].

    Raises InputError for points that fix no direction.
    """
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
    """A 4 x 4 (or 3 x 3) matrix from its numbers, row by row.
    Raises InputError for another count of numbers."""
    if len(numbers) not in (9, 16):
        raise InputError(f"{where}: a matrix needs 16 numbers, not {len(numbers)}")
    side = 3 if len(numbers) == 9 else 4
    matrix = np.eye(4)
    matrix[:side, :side] = np.reshape(numbers, (side, side))
    return matrix


def rgb(text: str, where: str) -> Colour:
    """A colour of one or three numbers or `#rrggbb`. Raises InputError for anything else, naming `where`."""
    if text.strip().startswith("#"):
        r, g, b = hex_to_linear(text.strip()).tolist()
        return Colour(rgb=(r, g, b))
    numbers = numbers_of(text, where)
    numbers = numbers * 3 if len(numbers) == 1 else numbers
    if len(numbers) != 3:
        raise InputError(f"{where}: a colour needs three numbers, not {len(numbers)}")
    return Colour(rgb=(numbers[0], numbers[1], numbers[2]))


def spectrum_of(text: str, where: str) -> Colour:
    """A spectrum: one number, or pairs `nm:value`. Raises InputError for anything else."""
    if ":" not in text:
        numbers = numbers_of(text, where)
        if len(numbers) == 1:
            return Colour(value=numbers[0])
        raise InputError(f"{where}: a spectrum is one number, or pairs like 400:0.1, 500:0.2")
    pairs = [numbers_of(pair.replace(":", " "), where) for pair in re.split(r"[\s,]+", text.strip()) if pair]
    if any(len(pair) != 2 for pair in pairs):
        raise InputError(f"{where}: a spectrum is one number, or pairs like 400:0.1, 500:0.2")
    return Colour(samples=tuple(sorted((a, b) for a, b in pairs)))
