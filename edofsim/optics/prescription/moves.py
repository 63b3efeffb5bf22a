"""Surfaces out of their place: decentred, tilted, shifted along the axis. Lengths in
millimetres."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

Three = tuple[float, float, float]
Vector = tuple[Tensor, Tensor, Tensor]


@dataclass(frozen=True)
class Move:
    """How a surface is moved, in the frame that rays are traced in (right, up, along the light).

    shift: of all its points. turn: rotation before that, radians about the three axes; its direction is the
    axis, its length the angle. pivot: where the turn's centre is on the lens's axis, from the vertex on.
    """

    shift: Three = (0.0, 0.0, 0.0)
    turn: Three = (0.0, 0.0, 0.0)
    pivot: float = 0.0

    def into(self, place: Vector, direction: Vector) -> tuple[Vector, Vector]:
        """A ray as the surface sees it."""
        x, y, z = self.shift
        turned = _turned(_rotation(self.turn).T, (place[0] - x, place[1] - y, place[2] - z - self.pivot))
        return (turned[0], turned[1], turned[2] + self.pivot), _turned(_rotation(self.turn).T, direction)

    def back(self, place: Vector, direction: Vector) -> tuple[Vector, Vector]:
        """What `into` is the inverse of."""
        x, y, z = self.shift
        turned = _turned(_rotation(self.turn), (place[0], place[1], place[2] - self.pivot))
        moved = turned[0] + x, turned[1] + y, turned[2] + z + self.pivot
        return moved, _turned(_rotation(self.turn), direction)


def _rotation(turn: Three) -> Tensor:
    """The matrix of a rotation, by Rodrigues' formula."""
    angle = math.hypot(*turn)
    x, y, z = turn
    cross = torch.tensor([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]], dtype=torch.float64)
    first = math.sin(angle) / angle if angle else 1.0
    second = 2 * (math.sin(angle / 2) / angle) ** 2 if angle else 0.5
    return torch.eye(3, dtype=torch.float64) + first * cross + second * cross @ cross


def _turned(matrix: Tensor, vector: Vector) -> Vector:
    x, y, z = (row[0] * vector[0] + row[1] * vector[1] + row[2] * vector[2] for row in matrix.tolist())
    return x, y, z
