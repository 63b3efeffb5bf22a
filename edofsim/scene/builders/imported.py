"""Meshes of the user's as objects of a scene."""

from __future__ import annotations

import logging
from dataclasses import replace
from typing import Literal

import numpy as np

from ...recipe.base import Positive
from ...recipe.placed import Placed
from ...recipe.surfaces import AnySurface, MattSurface, MeshTexture
from .. import solids
from ..mesh_colours import painted_parts
from ..mesh_files import read_content
from .context import Builder, Context, Part

LOG = logging.getLogger(__name__)


class MeshFile(Builder, Placed):
    """A mesh of yours (OBJ, PLY, GLB, STL); the path is relative to the recipe's folder.

    The file's axes are taken as x right, y up, z towards the viewer, as most programs write them."""

    kind: Literal["mesh"]
    path: str
    """mesh file (OBJ, PLY, GLB, STL), relative to the recipe's folder"""
    size_mm: Positive
    """longest side of the bounding box after scaling"""
    surface: AnySurface = MattSurface(kind="matt", texture=MeshTexture(kind="mesh"))
    """what it is made of; without one it is matt, of the colours and pictures of its file"""
    smooth: bool = True
    """whether normals are interpolated across faces"""
    allow_outside: bool = False
    """whether the mesh's file may name files outside its own folder"""

    def build(self, context: Context) -> list[Part]:
        """The file's triangles about the centre of their bounding box, scaled to `size_mm`."""
        content = read_content(context.base / self.path, context.what, self.smooth, self.allow_outside)
        low, high = content.mesh.vertices.min(axis=0), content.mesh.vertices.max(axis=0)
        scale = self.size_mm * 1e-3 / float((high - low).max())
        # files have z towards the viewer, camera space away from it: in z alone, nothing is mirrored
        flip = np.diag([1.0, 1.0, -1.0]) * scale
        whole = solids.moved(content.mesh, shift=-(low + high) / 2)
        by_file = isinstance(getattr(self.surface, "texture", None), MeshTexture)
        plain = self.surface.model_copy(update={"texture": None}) if by_file else self.surface
        surface = context.surface(plain)
        if not content.paint.any or not by_file:
            if content.paint.any:
                LOG.warning(
                    '%s: the colours of %s are not used, its surface is: texture = { kind = "mesh" } in it '
                    "takes them",
                    *(context.what, self.path),
                )
            return [Part("", solids.moved(whole, flip), surface)]
        pieces = painted_parts(whole, content.paint, context.wavelengths)
        return [
            Part(
                f"piece-{number}" if len(pieces) > 1 else "",
                solids.moved(piece, flip),
                replace(surface, reflectance=carrier),
            )
            for number, (piece, carrier) in enumerate(pieces, start=1)
        ]
