"""Coded apertures."""

from __future__ import annotations

from typing import Annotated, Literal

import torch
from pydantic import Field, model_validator
from torch import Tensor

from .. import levin
from ..grid import PupilGrid, cell_amplitude, cell_overlap
from .base import Mask

LEVIN = "levin"


class CodedMask(Mask):
    """A binary amplitude code of equal cells that fill the square around the pupil.

    `pattern` is "levin" or rows of "0" (opaque) and "1" (open), the top row first; rows and columns may
    differ in number. "levin" is a pattern of 13 x 13 cells found by the criterion of A. Levin, R. Fergus,
    F. Durand, W. T. Freeman, "Image and depth from a conventional camera with a coded aperture", ACM Trans.
    Graph. 26, 70 (2007).
    """

    kind: Literal["coded"] = "coded"
    pattern: Literal["levin"] | Annotated[tuple[str, ...], Field(min_length=1, max_length=512)] = LEVIN
    """"levin", or rows of "0" (opaque) and "1" (open), the top row first"""

    @model_validator(mode="after")
    def _rectangular(self) -> CodedMask:
        if self.pattern == LEVIN:
            return self
        rows = self.pattern
        if not rows[0] or any(len(row) != len(rows[0]) for row in rows):
            raise ValueError("pattern needs rows of equal length, with at least one cell")
        if set("".join(rows)) - {"0", "1"}:
            raise ValueError('pattern rows may hold "0" (opaque) and "1" (open) only')
        if "1" not in "".join(rows):
            raise ValueError("pattern lets no light through: it needs at least one open cell")
        return self

    def transmission(self, grid: PupilGrid) -> tuple[Tensor, Tensor]:
        rows = levin.PATTERN if self.pattern == LEVIN else self.pattern
        cells = torch.tensor([[float(cell) for cell in row] for row in rows], dtype=torch.float64)
        amplitude, light = (
            along(grid, cells.shape[0]).flip(0, 1) @ cells @ along(grid, cells.shape[1]).T
            for along in (cell_amplitude, cell_overlap)
        )
        return amplitude, light
