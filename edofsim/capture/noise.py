"""What is left of the renderer's noise in a photo and in the ideal image that it is judged by.

A rendered view is a mean over samples, and so are both images made of it. A view holds half of what two
independent halves of its samples differ by: noise of the same kind, which is photographed here as light is.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import torch
from torch import Tensor

from ..optics import Camera
from ..render.view import View
from .fidelity import Fidelity
from .imaging import spectrum_of
from .photo import Photo
from .photograph import capture, depths_of
from .sensor import record, sensor_effects
from .sensor.mosaic import Mosaic

NoiseState = Literal["none", "taken out", "included"]
LAYERS = 8
"""Depth nodes between which noise is blurred: its power is wanted, not its picture."""


@dataclass(frozen=True)
class PhotoNoise:
    """Whether the ideal image of a photo has noise of its own, and whether scores are without it.

    ideal, image: half of what the halves of the samples differ by, [channel, y, x] each, in the ideal image,
        and in the photo as far as the optics let it through; None where that is not known, or nothing.
    """

    state: NoiseState = "none"
    ideal: Tensor | None = None
    image: Tensor | None = None


@torch.no_grad()
def photo_noise(
    view: View, camera: Camera, fidelity: Fidelity, photo: Photo, device: torch.device | str = "cpu"
) -> PhotoNoise:
    """The noise of a photo that `capture` made of a view.

    Nothing hides anything here, and depths are few (`LAYERS`): both matter at depth edges alone. A pixel that
    the sensor's saturation has clipped holds none.
    """
    if view.half_difference is None:
        return PhotoNoise("included" if view.noise > 0 else "none")
    layers = min(LAYERS, int(depths_of([view], camera, fidelity)[0].numel()))
    coarse = fidelity.changed({"occlusion": "none", "sub_apertures": 1, "layers": layers})
    differing = view.with_light(view.half_difference)
    light = spectrum_of(view)
    noise = capture(differing, camera, coarse, exposure=photo.exposure, spectrum=light, device=device)
    effects = sensor_effects(camera, fidelity)
    image = record(noise.clean, [effect for effect in effects if isinstance(effect, Mosaic)], 0)
    if any(effect.kind == "saturation" for effect in effects):
        image = image * (photo.image < 1)
    return PhotoNoise("taken out", noise.ideal, image)
