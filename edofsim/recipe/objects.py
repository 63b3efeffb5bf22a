"""The objects that a scene recipe can name, distinguished by their `kind`."""

from __future__ import annotations

from typing import Annotated

from .kinds import OBJECTS, OfKind
from .placed import Thing

AnyObject = Annotated[Thing, OfKind(OBJECTS)]
