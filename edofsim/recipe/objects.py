"""All objects and lights that a scene recipe can name, told apart by their `kind`."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from .lights import AnyLight
from .placed import Placed
from .places import CloudBank, Facade, Foliage, Hallway, Hills, Table, Wall
from .things import (
    Book,
    Box,
    Bus,
    Bust,
    Car,
    ColorChecker,
    Cylinder,
    Goblet,
    MeshFile,
    Mug,
    Panel,
    Pencil,
    Prism,
    Sphere,
    TextPage,
    UsafChart,
    Wire,
)

AnyObject = Annotated[
    Panel | Box | Sphere | Cylinder | Mug | Goblet | Prism | Book | Pencil | Wire | Bust | Bus | Car
    | UsafChart | ColorChecker | TextPage | MeshFile | Table | Wall | Hallway | Facade | Foliage | Hills
    | CloudBank,
    Field(discriminator="kind"),
]  # fmt: skip

__all__ = ["AnyLight", "AnyObject", "Placed"]
