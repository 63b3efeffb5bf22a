"""How far a simulation shifts the PSNR of the restored image: parts of the photo are restored with what it
leaves out, and without.

The tiles of `Spectra` are photographed by a plain simulation, with noise, and restored without what that one
leaves out. What a choice leaves out is the sum of its effects' differences: those of PSFs are inverse
transforms of their spectra, those of coarse photos are made finer by interpolation.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

import torch
from torch import Tensor
from torch.nn import functional

from ..capture import Photo
from ..capture.crop import crop
from ..capture.photograph import capture
from .choose import fidelity_of
from .effect import Values
from .estimate import Estimates
from .facts import Facts

Restore: TypeAlias = Callable[[Tensor, Tensor], Tensor]
"""The sharp image [channel, y, x] of a photo [channel, y, x] and of the part of the light [channel] that
leaves the windows of its PSFs."""

PLAIN: Mapping[str, Values] = {
    "bands": {"band_groups": 1, "group_wavelengths": 2},
    "depth layers": {"layers": 9},
    "sub-apertures": {"sub_apertures": 1},
}
"""Levels of effects that tiles are photographed with, where they are among those that were looked at."""


@dataclass(frozen=True)
class RestoredTiles:
    """Tiles of the view of some facts, and what restores them. estimates: with their differences, see
    `estimate`."""

    facts: Facts
    estimates: Estimates
    restore: Restore

    def shift_db(self, chosen: Mapping[str, int]) -> float:
        """How much higher the PSNR of the restored image is with these levels than in full: negative where
        it suffers."""
        if not any(self.estimates.left_out(chosen)):
            return 0.0
        restored = self._restored(self._photos + self._left_out(chosen)) - self._before
        left = self._before - self._ideal
        mean = self.facts.spectra.mean
        more = mean(2 * left * restored, seen=1) + mean(restored.square(), seen=2)
        return -10 * math.log10(max(1 + more / self._error, 1e-6))

    @property
    def psnr_db(self) -> float:
        """Of what is restored from the full simulation."""
        return -10 * math.log10(self._error)

    @cached_property
    def _error(self) -> float:
        """Mean square that restoring the full simulation leaves, without the noise of a preview's truth."""
        facts = self.facts
        left = self._before - self._ideal
        found = facts.spectra.mean(left.square() * facts.spectra.taper, seen=1)
        of_preview = max(0.0, facts.view.noise) ** 2 * (1 - facts.noisier**-2)
        noise = of_preview * float(facts.levels_of_light.square().mean())
        return max(found - noise, 0.1 * found, 1e-12)

    def _left_out(self, chosen: Mapping[str, int]) -> Tensor:
        """What levels change in the photos of the tiles, under their window: [tile, channel, y, x]."""
        images, noise, bias = self.estimates.left_out(chosen)
        change = torch.zeros_like(self._taken.image)
        for image in images:
            change += self._on_tiles(self.estimates.differences[image])
        draw = torch.Generator().manual_seed(0)
        independent = noise**0.5 * torch.randn(change.shape, generator=draw)
        return change + (independent + bias) * self.facts.spectra.taper

    @cached_property
    def _plain(self) -> dict[str, int]:
        """Number of the level that each effect is photographed with."""
        found = {}
        for row in self.estimates.rows:
            name, wanted = row.effect.name, PLAIN.get(row.effect.name, {})
            same = [level for level in range(row.full) if wanted.items() <= row.levels[level].change.items()]
            found[name] = same[0] if wanted and same else row.full
        return found

    @cached_property
    def _taken(self) -> Photo:
        """Photos of the tiles, [tile, channel, y, x]."""
        facts, spectra = self.facts, self.facts.spectra
        side = spectra.side
        views = [crop(facts.view, top, left, side, side, side // 2) for top, left in spectra.corners]
        fidelity = fidelity_of(self.estimates, self._plain, spectra.full)
        return capture(views, facts.camera, fidelity, exposure=facts.exposure, spectrum=facts.spectrum)

    @cached_property
    def _photos(self) -> Tensor:
        """What the full simulation makes of the tiles, with noise."""
        return self._taken.image - self._left_out(self._plain)

    @cached_property
    def _ideal(self) -> Tensor:
        return self._taken.ideal.clamp(0, 1)

    @cached_property
    def _before(self) -> Tensor:
        return self._restored(self._photos)

    def _restored(self, photos: Tensor) -> Tensor:
        pairs = zip(photos, self._taken.truncated, strict=True)
        return torch.stack([self.restore(photo, truncated) for photo, truncated in pairs]).clamp(0, 1)

    def _on_tiles(self, difference: Tensor) -> Tensor:
        """A difference [channel, n] (see `Effect.differences`) on the tiles, under their window: [tile,
        channel, y, x]. What was seen elsewhere is taken for noise."""
        spectra, coarse = self.facts.spectra, self.facts.coarse
        size = difference.shape[1]
        if size == spectra.size:
            return spectra.images(difference)
        height, width = coarse.view.height, coarse.view.width
        if size == height * width:
            frame = difference.unflatten(1, (height, width))[None] * size**0.5
            fine = functional.interpolate(frame, scale_factor=coarse.times, mode="bilinear")[0]
            return torch.stack([_part(fine, *corner, spectra.side) for corner in spectra.corners]) * (
                spectra.taper
            )
        draw = torch.Generator().manual_seed(size)
        noise = torch.randn(self._taken.image.shape, generator=draw)
        return noise * torch.linalg.vector_norm(difference, dim=1)[:, None, None] * spectra.taper


def _part(image: Tensor, top: int, left: int, side: int) -> Tensor:
    """A square of an image [channel, y, x], whose border goes on beyond it."""
    rows = torch.arange(top, top + side).clamp(0, image.shape[-2] - 1)
    columns = torch.arange(left, left + side).clamp(0, image.shape[-1] - 1)
    return image[:, rows][:, :, columns]
