"""Mask, optics and network as one differentiable machine: from a sharp scene to the loss."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Protocol

import torch
from torch import Tensor, nn

from ..capture.planes import capture_planes, surroundings, truncated_light
from ..capture.sensor import Signal, sensor_effects
from ..optics import Camera
from ..restore.light import keep_light
from ..restore.restorer import Restorer
from .doe import MaskMaps, maps_of
from .training_camera import MIDDLE, TrainingCamera


@dataclass(frozen=True)
class Captured:
    """clean, ideal: [batch, 3, y, x], the photo without noise and what it should show. truncated: scalar, the
    fraction of light that left the PSFs' window. psf: of each scene, see `TrainingCamera.psfs`, where it has
    one that others may have, too. broadband: whether the sensor saw all wavelengths through its response, in
    place of three lines. light: [batch], on the sensor over that on the axis, where it differs: photos are
    brought to the light of the axis, as `restore` does it, and their noise is as much larger. noisy: whether
    the photo has its noise already.
    """

    clean: Tensor
    ideal: Tensor
    truncated: Tensor
    psf: Tensor | None = None
    broadband: bool = False
    light: Tensor | None = None
    noisy: bool = False


def captured(
    clean: Tensor,
    ideal: Tensor,
    truncated: Tensor,
    psf: Tensor | None = None,
    *,
    saturates: bool,
    broadband: bool = False,
    light: Tensor | None = None,
) -> Captured:
    """What lies beyond full scale is not asked of the network, and not seen by a sensor that saturates: with
    less light on it, full scale is brighter.

    clean, ideal: [batch, 3, y, x].
    truncated: scalar [].
    psf: [batch, 3, window, window].
    light: [batch], relative to the axis.
    saturates: whether full scale is the most that is seen.
    broadband: see `Captured`.
    """
    if saturates:
        clean = clean.clamp_max(1) if light is None else clean.minimum(1 / light[:, None, None, None])
    return Captured(clean, ideal.clamp_max(1), truncated, psf if light is None else None, broadband, light)


class Scenes(Protocol):
    """A batch that can be photographed."""

    def photograph(self, optics: TrainingCamera) -> Captured:
        """The photo without noise, by the mask as it is made.

        optics: with the mask as it is made.
        """

    def reusing(self, psf: Tensor, broadband: bool) -> Scenes:
        """The same scenes with the PSFs of an earlier photo, and its light, where they can be used again.

        psf: [batch, 3, window, window].
        broadband: as of that photo, see `Captured`.
        """


@dataclass(frozen=True)
class Planes:
    """Patches with their surroundings [batch, 3, y, x], each a plane at its inverse depth [batch].

    psf: those of an earlier photo, see `TrainingCamera.psfs`, in place of the depths.
    mean: of the pictures that the patches are from, [batch, 3], None for the patches' own.
    saturates: whether the photo is clipped at full scale.
    broadband: see `Captured`.
    places: [batch, 2] in the frame, see `TrainingCamera.of_planes`.
    shift: of the wavelengths of broadband light, likewise.
    """

    sharp: Tensor
    inverse_depths: Tensor
    psf: Tensor | None = None
    mean: Tensor | None = None
    saturates: bool = False
    broadband: bool = False
    places: Tensor | None = None
    shift: float = MIDDLE

    def photograph(self, optics: TrainingCamera) -> Captured:
        """Each colour sees one wavelength, as in the paper, or the same light of all that the sensor sees.

        optics: with the mask as it is made.
        """
        sharp = self.sharp.to(optics.device)
        psf, light = self.psf, None
        if psf is None:
            psf, light = optics.of_planes(self.inverse_depths, self.broadband, self.places, self.shift)
        before, after = surroundings(optics.window)
        ideal = sharp[..., before : sharp.shape[-2] - after, before : sharp.shape[-1] - after]
        mean = None if self.mean is None else self.mean.to(optics.device)
        truncated = truncated_light(psf).mean()
        how = {"saturates": self.saturates, "broadband": self.broadband, "light": light}
        return captured(capture_planes(sharp, psf, mean), ideal, truncated, psf, **how)

    def reusing(self, psf: Tensor, broadband: bool) -> Scenes:
        return replace(self, psf=psf, broadband=broadband)


class PooledCamera(Protocol):
    """One of many cameras that a network is trained over."""

    @property
    def optics(self) -> TrainingCamera: ...

    def select_psfs(self, network: Restorer) -> None:
        """Condition the network on it."""

    def seen(self, network: Restorer, photo: Tensor, captured: Captured) -> Tensor:
        """What the network is given of a photo [batch, 3, y, x], [batch, channel, y, x].

        photo: [batch, 3, y, x].
        network: that restores it.
        captured: the photo without its noise.
        """


@dataclass(frozen=True)
class Draw:
    """All that is random in a step.

    read_noise: [batch], standard deviations relative to full scale.
    generator: for the noise itself, on the device of the photo.
    camera: that takes the photo in place of the system's.
    """

    scenes: Scenes
    read_noise: Tensor
    generator: torch.Generator
    camera: PooledCamera | None = None


@dataclass(frozen=True)
class JudgedPhotos:
    """loss: scalar with its graph.
    photo, restored, ideal: [batch, 3, y, x].
    psf, broadband: see `Captured`.
    """

    loss: Tensor
    photo: Tensor
    restored: Tensor
    ideal: Tensor
    psf: Tensor | None
    broadband: bool


class System(nn.Module):
    """mask() gives its maps (`doe.maps_of`); network restores; loss is that of a restored image and the ideal
    one, [batch, 3, y, x] each.

    truncated_energy: weight of the light that leaves the PSFs' window.
    height_noise: standard deviation in metres, added anew to each sample of the height map in every step, for
        the errors of fabrication.
    depth_range: least and largest inverse depth in 1/m. bfloat16 applies to the network alone: the optics
        stay in float32.
    light_kept: see `recipe.train.LossTable`.
    """

    def __init__(
        self,
        optics: TrainingCamera,
        mask: nn.Module,
        network: Restorer,
        loss: Callable[[Tensor, Tensor], Tensor],
        truncated_energy: float,
        height_noise: float,
        depth_range: tuple[float, float],
        bfloat16: bool = False,
        light_kept: bool = False,
    ) -> None:
        super().__init__()
        self.depth_range, self.truncated_energy = depth_range, truncated_energy
        self.optics, self.loss = optics, partial(loss)  # no part of the system, be it a module
        self.height_noise, self.in_bfloat16, self.light_kept = height_noise, bfloat16, light_kept
        self.mask, self.network = mask, network
        self._known: dict[bool, object] = {}

    def forward(self, draw: Draw) -> JudgedPhotos:
        """A photo of the drawn scenes, restored and judged."""
        maps = maps_of(self.mask)
        if draw.camera is None:
            captured = self.capture(draw, maps)
            self.select_psfs(captured.broadband)
        else:
            captured = draw.scenes.photograph(draw.camera.optics)
            draw.camera.select_psfs(self.network)
        optics = self.optics if draw.camera is None else draw.camera.optics
        photo = recorded(captured, draw, optics.camera)
        seen = photo if draw.camera is None else draw.camera.seen(self.network, photo, captured)
        restored = self.restore(seen, maps)
        # what is shown ends at full scale, as the truth does
        restored = torch.where(captured.ideal < 1, restored, restored.clamp_max(1))
        if self.light_kept:
            restored = keep_light(captured.ideal, restored)
        photo, restored, ideal = (self._inside(image) for image in (photo, restored, captured.ideal))
        loss = self.loss(restored, ideal)
        loss = loss + self.truncated_energy * captured.truncated
        psf = None if captured.psf is None else captured.psf.detach()
        return JudgedPhotos(loss, photo, restored, ideal, psf, captured.broadband)

    def _inside(self, image: Tensor) -> Tensor:
        """Without the border that the network cannot know, where a patch is wide enough."""
        border = self.network.border
        if border == 0 or min(image.shape[-2:]) <= 3 * border:
            return image
        return image[..., border:-border, border:-border]

    def capture(self, draw: Draw, maps: MaskMaps) -> Captured:
        """The drawn scenes by a mask as it is made: with errors of fabrication."""
        height = maps.height
        if height is not None and self.height_noise > 0:
            maps = maps._replace(height=height + self.height_noise * _normal(height, draw.generator))
        return draw.scenes.photograph(self.optics.with_mask(maps))

    def restore(self, photo: Tensor, maps: MaskMaps) -> Tensor:
        """What the network sees, photo [batch, channel, y, x], to [batch, 3, y, x], float32.

        photo: [batch, channel, y, x].
        maps: of the mask as it is designed.
        """
        if self.network.psfs == "designed":
            return self.network.restored_with(photo, self._designed_psfs(maps))
        photo = photo.contiguous(memory_format=torch.channels_last)
        restore = self.network.unclamped if self.light_kept else self.network
        with torch.autocast(photo.device.type, torch.bfloat16, enabled=self.in_bfloat16):
            return restore(photo).to(torch.float32)

    def set_initial_psfs(self, noise: float) -> None:
        """Give a network that is conditioned on the optics the PSFs of the mask as it is, made with the mean
        error of fabrication; one for any camera the noise, too.

        noise: standard deviation, relative to full scale.
        """
        if self.network.psfs != "mean":
            return
        psf = self._mean_psfs(broadband=False)
        if self.network.any_camera:
            self.network.set_camera(psf, noise)
        else:
            self.network.set_psfs(psf)

    @torch.no_grad()
    def _mean_psfs(self, broadband: bool) -> Tensor:
        depths = self.network.psf_depths(self.depth_range)
        maps = maps_of(self.mask)
        noise = 0.0 if maps.height is None else self.height_noise
        return self.as_wanted(self.optics.with_mask(maps).psfs(depths, broadband, noise))

    def as_wanted(self, psf: Tensor) -> Tensor:
        """PSFs as the network wants them: by colour or, of white, by channel.

        psf: [depth, 3, window, window] or [depth, channel, colour, window, window].
        """
        return psf.sum(2) if psf.ndim == 5 and not self.network.colour_psfs else psf

    def select_psfs(self, broadband: bool) -> None:
        """Condition the network on the light that the sensor sees, where some of it is broadband. What is
        saved knows three lines."""
        if self.network.psfs != "mean" or self.network.any_camera or not (broadband or self._known):
            return
        if not self._known:
            self._known[False] = self.network.psf_state()
        if broadband not in self._known:
            self.network.set_psfs(self._mean_psfs(broadband))
            self._known[broadband] = self.network.psf_state()
        self.network.load_psf_state(self._known[broadband])

    def store_final_psfs(self) -> None:
        """Give a network that restores by the PSFs of each step those of the mask as it is now, for its
        checkpoint, and one that is conditioned on them those of the three colours."""
        self.select_psfs(broadband=False)
        if self.network.psfs == "designed":
            with torch.no_grad():
                self.network.set_psfs(self._designed_psfs(maps_of(self.mask)))

    def _designed_psfs(self, maps: MaskMaps) -> Tensor:
        return self.optics.with_mask(maps).psfs(self.network.psf_depths(self.depth_range))


def recorded(captured: Captured, draw: Draw, camera: Camera) -> Tensor:
    """The photo [batch, 3, y, x] as the sensor records it: its effects in their order, with the read noise of
    the draw in place of its own. One that has its noise already is left as it is.

    captured: the photo without noise.
    draw: read noise, and the generator of all noise.
    camera: its sensor.
    """
    clean = captured.clean
    if captured.noisy:
        return clean
    sensor = camera.recipe.sensor.model_copy(update={"read_noise": 1.0})
    effects = sensor_effects(replace(camera, recipe=camera.recipe.model_copy(update={"sensor": sensor})))
    light = None if captured.light is None else captured.light[:, None, None, None]
    noise = draw.read_noise.to(clean)[:, None, None, None]
    if len(effects) == 1:
        return clean + (noise if light is None else noise / light) * _normal(clean, draw.generator)
    signal, others = Signal(clean if light is None else clean * light), _on_cpu(draw.generator)
    for effect in effects:
        if effect.kind == "read-noise":
            added = noise * _normal(clean, draw.generator)
            added = added if signal.seen is None else added * signal.seen
            signal = Signal(signal.image + added, signal.seen)
        else:
            signal = effect.act(signal, others)
    return signal.image if light is None else signal.image / light


def _on_cpu(generator: torch.Generator) -> torch.Generator:
    """What effects of a sensor draw from, wherever the photos are."""
    seed = torch.randint(2**62, (), generator=generator, device=generator.device)
    return torch.Generator().manual_seed(int(seed))


def _normal(like: Tensor, generator: torch.Generator) -> Tensor:
    where = generator.device
    return torch.randn(like.shape, generator=generator, dtype=like.dtype, device=where).to(like.device)
