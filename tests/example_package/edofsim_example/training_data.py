"""A source of training data: noise of many scales, which no file needs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import torch
from torch.nn.functional import interpolate

from edofsim.plugins import Planes, Scenes, TrainingReader, Wanted, surroundings


@dataclass(frozen=True)
class NoiseSource:
    """Planes of noise. size: pixels of a patch with its surroundings; depths: ends of inverse depth, 1/m."""

    size: int
    depths: tuple[float, float]
    described: dict[str, object]
    sha256: str

    def draw(self, count: int, generator: torch.Generator) -> Scenes:
        low, high = self.depths
        sharp = torch.full((count, 3, self.size, self.size), 0.5)
        for cells in (4, 8, 16):
            coarse = torch.rand(count, 3, cells, cells, generator=generator) - 0.5
            sharp += interpolate(coarse, size=(self.size, self.size), mode="bilinear") / 3
        return Planes(sharp, low + (high - low) * torch.rand(count, generator=generator))

    def validation(self, count: int) -> list[Scenes]:
        return [self.draw(1, torch.Generator().manual_seed(number)) for number in range(count)]


class Noise(TrainingReader):
    """Noise of many scales, as planes at one depth."""

    kind: Literal["noise"] = "noise"

    def open(self, wanted: Wanted) -> NoiseSource:
        size = wanted.recipe.data.patch_px + sum(surroundings(wanted.optics.window))
        depths = wanted.recipe.capture.inverse_depth_per_m
        return NoiseSource(size, depths, {"kind": self.kind}, "noise of version 1")
