"""Builders of objects, one module a family: recipe of one object -> its parts, in local metres."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from .basic import box, cylinder, goblet, mug, panel, prism, sphere
from .bust import bust
from .context import Context, Part
from .hallway import hallway
from .imported import mesh_file
from .landscape import clouds, facade, foliage, hills
from .room import table, wall
from .stationery import book, pencil, text_page, wire
from .targets import color_checker, usaf_chart
from .vehicles import bus, car

BUILDERS: Mapping[str, Callable[..., list[Part]]] = {
    "panel": panel,
    "box": box,
    "sphere": sphere,
    "cylinder": cylinder,
    "mug": mug,
    "table": table,
    "wall": wall,
    "book": book,
    "pencil": pencil,
    "wire": wire,
    "bust": bust,
    "usaf_chart": usaf_chart,
    "color_checker": color_checker,
    "text_page": text_page,
    "hills": hills,
    "mesh": mesh_file,
    "goblet": goblet,
    "prism": prism,
    "bus": bus,
    "car": car,
    "hallway": hallway,
    "facade": facade,
    "foliage": foliage,
    "clouds": clouds,
}

__all__ = ["BUILDERS", "Context", "Part"]
