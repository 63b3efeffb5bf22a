"""Ways to composite depth edges, each by its best setting, next to a truth."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from ..capture import Fidelity, capture
from ..capture.crop import crop as cropped
from ..capture.occlusion import OCCLUSIONS
from ..capture.photograph import all_in_focus
from ..capture.prepare import channel_weights
from ..capture.sensor import automatic_exposure
from ..optics import Camera
from ..reference.pinhole import Crop
from ..render.view import View
from ..restore.scores import psnr

SUB_APERTURES = 4
"""Along each axis of the pupil."""
WAYS = (*OCCLUSIONS, "sub_apertures")
TOLERANCE_DB = 60.0
"""Of the depth nodes of the compositors: their step is then no part of what is measured."""
SNAPPED = ("over", "normalised")
"""Ways whose layers are of whole surfaces."""
LAYERS = (2, 3, 4, 5, 6, 8, 12, 16, 24, None)
"""Numbers of layers that these are tried with; None: as many as `TOLERANCE_DB` asks for."""


@dataclass(frozen=True)
class Judged:
    """A crop photographed each way, noise-free, next to its truth, both exposed: [channel, y, x].

    layers: of the ways `SNAPPED`, the number that is best.
    exposure: factor, automatic for the crop.
    """

    photos: dict[str, Tensor]
    truth: Tensor
    layers: dict[str, int]
    exposure: float

    def figures(self, case: str) -> dict[str, float]:
        """PSNR of each way, and numbers of layers, by name."""
        scores = {f"psnr_db.{case}.{way}": psnr(photo, self.truth) for way, photo in self.photos.items()}
        return scores | {f"layers.{case}.{way}": float(count) for way, count in self.layers.items()}


def composites(view: View, where: Crop, camera: Camera, truth: Tensor) -> Judged:
    """The crop photographed each way, next to a truth [channel, y, x] that is not exposed.

    truth: [channel, y, x], not exposed.

    The slow truth has no light beyond the PSFs' windows, so that the glare that it becomes is taken off.
    """
    window = camera.recipe.psf.window_px
    part = cropped(view, where.top, where.left, where.height, where.width, window // 2)
    part = part.to(dtype=torch.float32)
    weights = channel_weights(camera, part.wavelengths).float()
    sharp = all_in_focus(part, weights)
    factor = automatic_exposure(part.crop_margin(sharp), noisy=view.noise > 0)
    truth = truth * factor

    def taken(way: str, layers: int | None = None) -> tuple[int, Tensor]:
        fidelity = Fidelity(
            layers=layers,
            layers_db=TOLERANCE_DB,
            occlusion="hidden" if way == "sub_apertures" else way,
            sub_apertures=SUB_APERTURES if way == "sub_apertures" else 1,
        )
        photo = capture(part, camera, fidelity, exposure=factor)
        glare = photo.truncated * sharp.mean((1, 2)) * factor
        return photo.how.layers, photo.clean - glare[:, None, None]

    photos: dict[str, Tensor] = {}
    best: dict[str, int] = {}
    for way in WAYS:
        if way in SNAPPED:
            tried = dict(taken(way, count) for count in LAYERS)
            scores = {count: psnr(photo, truth) for count, photo in tried.items()}
            best[way] = max(scores, key=scores.__getitem__)
            photos[way] = tried[best[way]]
        else:
            photos[way] = taken(way)[1]
    return Judged(photos, truth, best, factor)
