"""Patches with an edge of depth: one photograph in front of another.

A network that has only seen planes takes every place for a part of one, and does harm where two distances
meet. Here both are known, what is hidden too, and the photo is composited from them as `expose` does: the
near picture blurred, over the far one where the blurred cover of the near one lets it by (Ikoma et al. 2021).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from torch import Tensor
from torch.nn import functional

from ..capture.planes import capture_planes, surroundings, truncated_light
from .system import Captured, captured
from .training_camera import MIDDLE, TrainingCamera

SHAPES = (2, 5)  # bumps of a cover across a patch with its surroundings, least and most


@dataclass(frozen=True)
class Edges:
    """Patches with their surroundings [batch, 3, y, x], each a plane at its inverse depth [batch], ascending;
    patch i lies in front of patch i - 1, where cover [batch, 1, y, x] is 1.

    psf, mean, saturates, broadband, places, shift: see `Planes`.
    """

    sharp: Tensor
    cover: Tensor
    inverse_depths: Tensor
    psf: Tensor | None = None
    mean: Tensor | None = None
    saturates: bool = False
    broadband: bool = False
    places: Tensor | None = None
    shift: float = MIDDLE

    def photograph(self, optics: TrainingCamera) -> Captured:
        """With the light of `Planes`."""
        sharp, cover = self.sharp.to(optics.device), self.cover.to(optics.device)
        far = torch.arange(len(sharp)) - 1
        near = torch.arange(len(sharp))
        near[0], far[0] = len(sharp) - 1, 0  # the last is nearer than the first
        if optics.varies:  # both of a patch are at its place
            seen = self.broadband, self.places, self.shift
            psf, light = optics.of_planes(self.inverse_depths[near], *seen)
            behind = optics.of_planes(self.inverse_depths[far], *seen)[0]
            over = psf
        else:
            psf = self.psf
            if psf is None:
                psf = optics.psfs(self.inverse_depths, self.broadband, shift=self.shift)
            light, over, behind = None, psf[near], psf[far]
        means = sharp.mean((-1, -2)) if self.mean is None else self.mean.to(optics.device)
        covered = cover.mean((-1, -2))
        front = capture_planes(cover * sharp[near], over, covered * means[near])
        shade = capture_planes(cover.expand_as(sharp), over)
        clean = front + (1 - shade) * capture_planes(sharp[far], behind, means[far])
        before, after = surroundings(optics.window)
        ideal = cover * sharp[near] + (1 - cover) * sharp[far]
        ideal = ideal[..., before : ideal.shape[-2] - after, before : ideal.shape[-1] - after]
        how = {"saturates": self.saturates, "broadband": self.broadband, "light": light}
        return captured(clean, ideal, truncated_light(psf).mean(), psf, **how)

    def reusing(self, psf: Tensor, broadband: bool) -> Edges:
        """With the PSFs of another photo, of ascending inverse depths.

        psf: [batch, 3, window, window], of ascending inverse depths.
        """
        return replace(self, psf=psf, broadband=broadband)


def draw_covers(count: int, size: int, generator: torch.Generator) -> Tensor:
    """Blobs with smooth borders a pixel wide, [count, 1, size, size], from 0 to 1; about half is covered."""
    covers = []
    for _ in range(count):
        bumps = int(torch.randint(SHAPES[0], SHAPES[1] + 1, (), generator=generator))
        coarse = torch.randn(1, 1, bumps + 2, bumps + 2, generator=generator)
        fine = functional.interpolate(coarse, size=(size, size), mode="bicubic", align_corners=False)
        down, across = torch.gradient(fine[0, 0])
        slope = (down.square() + across.square()).sqrt().clamp_min(1e-6)
        covers.append((0.5 + fine[0] / slope).clamp(0, 1))
    return torch.stack(covers)
