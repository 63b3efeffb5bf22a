"""What images are scored against, in one place: the ideal image of a photo, and what noise both have in
common.

A photo and the ideal image are made of the same samples, so that what restores the photo restores some of the
ideal image's noise. How much is found by restoring the photo once more, with that noise added to it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from ..capture.noise import NoiseState, PhotoNoise
from ..capture.photo import Photo
from ..errors import InputError
from .scores import DEPTH_EDGES_M, DepthScore, Noise, Score, TruthNoise, score_by_depth
from .scores import score as whole_score

SAID: dict[NoiseState, str] = {
    "none": "the ideal image has no noise: it is not rendered",
    "taken out": "scores are without the noise of the rendering",
    "included": "the view does not tell its noise, which counts as an error here: render it again",
}
Restores = Callable[[Tensor], Tensor]


@dataclass(frozen=True)
class Truth:
    """ideal: [channel, y, x], full scale 1, not clipped.
    noise: of the photo that it is the ideal image of.
    """

    ideal: Tensor
    noise: PhotoNoise = PhotoNoise()

    def restored_noise(self, photo: Tensor, restored: Tensor, restores: Restores) -> Tensor | None:
        """What noise is left in an image that was restored from a photo; None where none is known.

        photo, restored: [channel, y, x].
        restores: what did it.
        """
        if self.noise.image is None:
            return None
        with torch.no_grad():
            return restores(photo + self.noise.image) - restored

    def compared(self, image: Tensor, noise: Tensor | None) -> tuple[Tensor, Tensor, TruthNoise]:
        """What `score_parts` and `score_by_depth` compare: an image, the truth, and their noise.

        image: [channel, y, x].
        noise: [channel, y, x]: what is left of it in the image, as of `restored_noise`; of the photo,
            `PhotoNoise.image`.
        """
        if self.noise.ideal is None or noise is None:
            return image, self.ideal, "none" if self.noise.state == "none" else "included"
        return image, self.ideal, Noise(self.noise.ideal, noise)


def noise_sentence(state: NoiseState, figures: Mapping[str, float]) -> str:
    """What became of the noise of the rendering in the figures of a run, in a sentence."""
    if state != "taken out":
        return SAID[state]
    error = figures["psnr_db_se.restored"]
    said = (
        f"{SAID[state]}, {figures['noise_db.truth']:.1f} dB in the ideal image and "
        f"{figures['noise_db.photo']:.1f} dB in the photo; standard error of the restored image's PSNR "
        f"{error:.2g} dB"
    )
    wanted = figures.get("samples_for_0.05_db")
    return said if wanted is None or error <= 0.05 else f"{said}, 0.05 dB with {wanted:.0f} samples a pixel"


def noise_figures(noise: PhotoNoise) -> dict[str, float]:
    """How far the noise of the rendering is below full scale, in dB: root mean square over ideal image and
    photo. Empty where it is not known."""
    parts = {"noise_db.truth": noise.ideal, "noise_db.photo": noise.image}
    levels = {name: float(part.double().square().mean()) for name, part in parts.items() if part is not None}
    return {name: -10 * math.log10(level) if level else math.inf for name, level in levels.items()}


def samples_for(score: Score, samples: int, wanted_db: float = 0.05) -> int | None:
    """Samples a pixel with which the standard error of a PSNR is at most `wanted_db`, no fewer than those
    that it was found with; it falls with their square root at least. None where no noise is known."""
    uncertain = score.psnr_db_se
    if not 0 < uncertain < math.inf:
        return None
    return max(samples, math.ceil(samples * (uncertain / wanted_db) ** 2 - 1e-9))


def score(
    image: Photo | Tensor, photo: Photo, *, by_depth: bool | Sequence[float] = False
) -> Score | tuple[DepthScore, ...]:
    """PSNR and SSIM against the ideal image of a photo, within full scale 1. The noise of a rendered view
    counts as an error.

    image: [channel, y, x], or a photo.
    photo: that has the ideal image.
    by_depth: scores of the pixels in each depth range that holds any: True for the ranges that reports have,
        or their limits [m], ascending.

    Raises InputError for images of other sizes, and for a photo whose depths are not known.
    """
    shown = image.image if isinstance(image, Photo) else image
    if by_depth is False:
        return whole_score(shown, photo.ideal)
    if photo.inverse_depth is None:
        raise InputError("score: the depths of this photo are not known; leave out by_depth")
    limits = DEPTH_EDGES_M if by_depth is True else tuple(by_depth)
    return score_by_depth(shown, photo.ideal, "none", photo.inverse_depth, limits)[1]
