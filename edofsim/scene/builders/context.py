"""What every builder of an object is asked for, what it is given, and what it gives back."""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...recipe.placed import Thing
from ...recipe.surfaces import AnySurface
from ..model import Surface, TriangleMesh
from ..surfaces import build_surface


@dataclass(frozen=True)
class Part:
    """A piece of an object with one surface, in the object's local metres; `suffix` tells pieces apart.

    emission: float32 [band], W/m2/sr/nm, of a piece that shines."""

    suffix: str
    mesh: TriangleMesh
    surface: Surface
    emission: np.ndarray | None = None


@dataclass(frozen=True)
class Context:
    """One object's surroundings: bands in metres, the recipe's folder, a seed, the object's name, and the
    tangent of the angle that a pixel sees, 0 where no camera is known."""

    wavelengths: np.ndarray
    base: Path
    seed: int
    what: str
    pixel_angle: float = 0.0

    def rng(self, purpose: str = "") -> np.random.Generator:
        """A random generator of this object alone, so that other objects don't change it.

        purpose: another generator for each.
        """
        return np.random.default_rng([self.seed, zlib.crc32(f"{self.what}/{purpose}".encode())])

    def surface(self, recipe: AnySurface, purpose: str = "surface") -> Surface:
        """The recipe's surface at the view's wavelengths.

        recipe: of the surface.
        purpose: as of `rng`.
        """
        return build_surface(recipe, self.wavelengths, self.base, self.rng(purpose), self.what)


class Builder(Thing):
    """An object's table, and how it is built. One that is also `Placed` says where its local origin is by
    the keys that all such objects share; another one by `origin`."""

    def build(self, context: Context) -> list[Part]:
        """Its pieces in local metres: x right, y up, z away from the camera. Raises InputError.

        context: bands, folder, seed and name of the object.
        """
        raise NotImplementedError

    def origin(self) -> tuple[float, float, float]:
        """Where in camera space the local origin of an object lies that is not `Placed`, in metres."""
        return 0.0, 0.0, 0.0
