"""Photos through a lens that varies over the field: each place is restored by its own PSFs, without seams."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from ..optics import Camera
from ..optics.field import Frame, Place, joined, places, relative_light, step_for


@dataclass(frozen=True)
class Method:
    """What restored a photo.

    name: of the network, or Wiener.
    reason: why no network did, where one was asked for.
    step_px: between places with filters of their own, 0 where all of the photo has the same.
    highlights: beyond full scale, which were taken off first.
    """

    name: str
    reason: str = ""
    step_px: int = 0
    highlights: int = 0

    def __str__(self) -> str:
        places = (f"place by place, {self.step_px} px apart",) if self.step_px else ()
        reason = (f"as {self.reason}",) if self.reason else ()
        count = f"{self.highlights} highlight{'s' * (self.highlights > 1)}"
        lamps = (f"{count} beyond full scale taken off",) if self.highlights else ()
        return ", ".join((self.name, *reason, *places, *lamps))


BY_WIENER = Method("Wiener")
RESTORED_DB = 40.0
"""By what PSNR the joined PSFs differ from those of each place: what is restored is itself farther off."""


def step_of(camera: Camera, frame: Frame, wavelengths: Tensor, inverse_depths: Tensor) -> int:
    """Pixels between places with filters of their own.

    wavelengths: [band], metres.
    inverse_depths: [depth], 1/m.
    """
    low, high = (float(end) for end in inverse_depths.aminmax())
    return step_for(camera, frame, wavelengths, (low, high), RESTORED_DB)


def restored_by_place(
    image: Tensor,
    camera: Camera,
    frame: Frame,
    step: int,
    restore: Callable[[Tensor, Camera], tuple[Tensor, Method]],
) -> tuple[Tensor, Method]:
    """A photo [channel, y, x] restored place by place, and what restored it.

    image: [channel, y, x].
    restore: takes and gives images [channel, y, x].

    Each place is restored from its part of the photo and half a window more on each side, by the camera that
    looks there. The photo is brought to the light of the axis first.
    """
    beyond = camera.recipe.psf.window_px // 2
    even = image / light_of(camera, frame, step).to(image)
    how = BY_WIENER

    def at(place: Place) -> Tensor:
        nonlocal how
        ends = []
        for part, size in ((place.rows, frame.height), (place.columns, frame.width)):
            ends.append((max(0, part.start - beyond), min(size, part.stop + beyond)))
        (top, bottom), (left, right) = ends
        sharp, how = restore(even[..., top:bottom, left:right], camera.seen_at(place.field))
        rows = slice(place.rows.start - top, place.rows.stop - top)
        columns = slice(place.columns.start - left, place.columns.stop - left)
        return sharp[..., rows, columns]

    restored = joined(frame, step, at).to(image)
    return restored, replace(how, step_px=step)


def light_of(camera: Camera, frame: Frame, step: int) -> Tensor:
    """Light on the sensor over that on the axis, float64 [y, x], as places `step` pixels apart have it."""
    light = torch.zeros(frame.height, frame.width, dtype=torch.float64)
    for place in places(frame, step):
        light[place.rows, place.columns] += relative_light(camera.seen_at(place.field)) * place.share
    return light
