"""What photographs the scenes of a training, and the PSFs that it does it with."""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from ..errors import InputError
from ..optics import PAPER_COLOURS, Camera, channel_psfs, mean_psfs, response, response_curves
from ..optics.field import relative_light
from ..optics.sampling import coarsest_pitch
from ..restore.photograph_statistics import colour_weights
from .doe import MaskMaps

WAVELENGTHS = 8
"""This many, evenly spaced, stand for all that a sensor sees."""
MIDDLE = 0.5  # of the distance between them


@dataclass(frozen=True)
class StoredPsfs:
    """PSFs that are looked up in place of being computed.

    values: float16 [n, 3, window, window], at the middles of n equal parts of a camera's range.
    drawn: least and largest inverse depth of the scenes, 1/m, which the range stands for.
    widest: blur without mask by which the ends of the range differ, in pixels.
    """

    values: Tensor
    drawn: tuple[float, float]
    widest: float

    def at(self, inverse_depths: Tensor) -> Tensor:
        """Float32 [depth, 3, window, window].

        inverse_depths: [depth], 1/m.
        """
        low, high = self.drawn
        part = (inverse_depths - low) / (high - low) * len(self.values)
        return self.values[part.long().clamp(0, len(self.values) - 1)].to(torch.float32)


@dataclass(frozen=True)
class TrainingCamera:
    """A camera whose mask may learn, or, of many that do not, one with stored PSFs.

    window: side of the PSFs in pixels.
    """

    camera: Camera
    window: int
    device: torch.device
    stored: StoredPsfs | None = None

    def with_mask(self, maps: MaskMaps) -> TrainingCamera:
        """The same with the mask of a step."""
        camera = self.camera.with_height(maps.height).with_amplitude(maps.amplitude)
        return replace(self, camera=camera)

    @property
    def varies(self) -> bool:
        """Whether PSFs are others at other places in the frame."""
        return self.stored is None and self.camera.lens.varies

    def seen_at(self, right: float, up: float) -> TrainingCamera:
        """The same that looks at a place in the frame, in pixels from the optical axis."""
        angle = self.camera.pixel_angle
        return replace(self, camera=self.camera.seen_at((right * angle, up * angle)))

    def of_planes(
        self,
        inverse_depths: Tensor,
        broadband: bool = False,
        places: Tensor | None = None,
        shift: float = MIDDLE,
    ) -> tuple[Tensor, Tensor | None]:
        """PSFs of planes, one each as of `psfs`, at its inverse depth [plane] and its place in the frame
        [plane, 2] (right, up, in pixels from the optical axis; None: all on it); and the light there [plane]
        over that on the axis, None where it is the same everywhere.

        inverse_depths: [plane], 1/m.
        places: [plane, 2] (right, up), pixels from the optical axis; None for the axis.
        shift: as of `psfs`.

        Raises InputError as `psfs`.
        """
        if not self.varies or places is None:
            return self.psfs(inverse_depths, broadband, shift=shift), None
        there = [self.seen_at(right, up) for right, up in places.tolist()]
        pairs = zip(there, inverse_depths, strict=True)
        psfs = [one.psfs(depth[None], broadband, shift=shift) for one, depth in pairs]
        light = torch.tensor([relative_light(one.camera) for one in there], device=self.device)
        return torch.cat(psfs), light

    def psfs(
        self,
        inverse_depths: Tensor,
        broadband: bool = False,
        height_noise: float = 0.0,
        shift: float = MIDDLE,
    ) -> Tensor:
        """PSFs of the three colours, float32 [depth, 3, window, window]; in broadband light, where a channel
        sees something of all colours, [depth, channel, colour, window, window] for the smoothest spectra.

        inverse_depths: [depth], 1/m.
        broadband: whether light is a few wavelengths, added up by the sensor's response, or three lines.
        height_noise: of the mask's samples, metres; the PSFs are then the mean, see `optics.mean_psfs`.
        shift: of the few wavelengths, as a part of their distance, 0 to 1.

        Raises InputError for a sensor whose response is not tabulated, where light is broadband.
        """
        if self.stored is not None:
            return self.stored.at(inverse_depths)
        if not broadband:
            how = {"window_px": self.window, "device": self.device}
            return mean_psfs(self.camera, PAPER_COLOURS, inverse_depths, height_noise, **how)
        curves = response_curves(self.camera)
        if curves is None:
            raise InputError("sensor.response: three lines have no other light; name a tabulated response")
        first, last = curves[0][0], curves[0][-1]
        wavelengths = first + (last - first) * (torch.arange(WAVELENGTHS) + shift) / WAVELENGTHS
        camera = self._sampled(wavelengths, inverse_depths)
        weights = colour_weights(wavelengths, response(camera, wavelengths))
        how = {"height_noise": height_noise, "window_px": self.window, "device": self.device}
        return channel_psfs(camera, wavelengths, inverse_depths, weights=weights, **how).unflatten(1, (3, 3))

    def _sampled(self, wavelengths: Tensor, inverse_depths: Tensor) -> Camera:
        """The camera with its pupil sampled as finely as the shortest of wavelengths asks for."""
        fixed = self.camera.recipe.psf.pupil_sampling_um
        if fixed == "auto":
            return self.camera
        coarsest = coarsest_pitch(self.camera, wavelengths, inverse_depths, self.window)
        return self.camera if fixed * 1e-6 <= coarsest else self.camera.with_pupil_sampling(coarsest)
