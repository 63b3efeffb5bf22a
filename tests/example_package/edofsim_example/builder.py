"""A builder: a pyramid on a square base."""

from __future__ import annotations

from typing import Literal

import numpy as np

from edofsim.plugins import AnySurface, Builder, Context, MattSurface, Part, Placed, Positive, mesh


class Pyramid(Builder, Placed):
    """A pyramid on a square base."""

    kind: Literal["pyramid"]
    width_mm: Positive = 40.0
    height_mm: Positive = 40.0
    surface: AnySurface = MattSurface(kind="matt")

    def build(self, context: Context) -> list[Part]:
        """About the middle of its base."""
        w, h = self.width_mm / 2 * 1e-3, self.height_mm * 1e-3
        corners = np.array([(-w, 0, -w), (w, 0, -w), (w, 0, w), (-w, 0, w), (0, h, 0)])
        faces = np.array([(0, 1, 2), (0, 2, 3), (0, 4, 1), (1, 4, 2), (2, 4, 3), (3, 4, 0)])
        return [Part("", mesh(corners, faces), context.surface(self.surface))]
