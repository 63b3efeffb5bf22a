"""What becomes of conclusions: the PSNR of restored photos, and their gain over the lens alone, in every case
whose cost is measured."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import torch
from torch import Tensor

from ..capture import Fidelity, Photo, capture
from ..capture.noise import photo_noise
from ..capture.sensor import record, sensor_effects
from ..optics import Camera
from ..render.view import View
from ..restore import restore
from ..restore.checkpoint import Checkpoint
from ..restore.scores import image_psnr
from ..restore.truth import Truth

Restore: TypeAlias = Callable[[Tensor, Tensor], Tensor]
"""The sharp image [channel, y, x] of a photo [channel, y, x] and of the part of the light [channel] that
leaves the windows of its PSFs."""
Scores = Mapping[str, list[float]]
"""PSNR against the all-in-focus image in dB, by what was restored with: one for each seed."""
GAIN = "gain over the lens alone"


def restoring(
    camera: Camera, wavelengths: Tensor, inverse_depth: Tensor, checkpoint: Checkpoint | None
) -> Restore:
    """What restores photos of a scene.

    wavelengths: [band], metres.
    inverse_depth: any shape [...], 1/m: of all that the photo may show.
    camera, checkpoint: as of `restore`.
    """
    ends = torch.stack(inverse_depth.double().cpu().aminmax())
    return lambda photo, truncated: restore(
        photo, camera, wavelengths, ends, checkpoint=checkpoint, truncated=truncated
    )[0]


@dataclass(frozen=True)
class Shift:
    """Of a score against that of the full simulation, in dB.

    mean: over seeds of the noise, the same in both.
    noise: standard deviation of the score itself from seed to seed.
    """

    mean: float
    noise: float


@dataclass(frozen=True)
class Judge:
    """What photos are restored by, by name, the first one counting for the gain over the lens alone.

    seeds: how often noise is drawn.
    alone: the camera without its mask, None where no gain is asked for.
    """

    restorers: Mapping[str, Restore]
    seeds: int = 1
    alone: Camera | None = None

    def scores(
        self,
        view: View,
        camera: Camera,
        fidelity: Fidelity,
        photo: Photo,
        device: str,
        alone: Fidelity | None = None,
    ) -> Scores:
        """Of a photo that was simulated by a fidelity, with as many draws of its noise as there are seeds.

        alone: how the photo through the lens alone is simulated, None for the same.
        """
        effects = sensor_effects(camera, fidelity)
        truth = Truth(photo.ideal, photo_noise(view, camera, fidelity, photo, device))
        images = [record(photo.clean, effects, seed) for seed in range(self.seeds)]
        found = {
            name: _levels(truth, images, lambda image, by=restore: by(image, photo.truncated))
            for name, restore in self.restorers.items()
        }
        if self.alone is not None:
            how = alone or fidelity
            plain = capture(view, self.alone, how, exposure=photo.exposure, device=device)
            rivals = [record(plain.clean, effects, seed) for seed in range(self.seeds)]
            best = next(iter(found.values()))
            left = photo_noise(view, self.alone, how, plain, device).image
            without = [_level(truth, image, left) for image in rivals]
            found[GAIN] = [mine - other for mine, other in zip(best, without, strict=True)]
        return found


def _levels(truth: Truth, images: Sequence[Tensor], restores: Callable[[Tensor], Tensor]) -> list[float]:
    """PSNR in dB of what is made of photos that differ by the sensor's noise alone, which hardly changes what
    is left of the rendering's."""
    restored = [restores(image) for image in images]
    left = truth.restored_noise(images[0], restored[0], restores)
    return [_level(truth, image, left) for image in restored]


def _level(truth: Truth, image: Tensor, left: Tensor | None) -> float:
    image, ideal, noise = truth.compared(image, left)
    return image_psnr(image, ideal, noise=noise)


def shifts(scores: Scores, of_full: Scores) -> Mapping[str, Shift]:
    """By what was restored with: how far scores are from those of the full simulation."""
    found = {}
    for name, values in scores.items():
        if name in of_full:
            mean = statistics.fmean(a - b for a, b in zip(values, of_full[name], strict=True))
            noise = float(np.std(of_full[name], ddof=1)) if len(values) > 1 else 0.0
            found[name] = Shift(mean, noise)
    return found
