"""Mask, optics and network as one differentiable machine: from a sharp scene to the loss."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import torch
from torch import Tensor, nn

from ..capture.planes import photograph, surroundings
from ..errors import InputError
from ..optics import PAPER_COLOURS, Camera, mean_psfs, psf_bank, response, response_curves
from ..optics.sampling import coarsest_pitch
from ..restore.light import keep_light
from ..restore.losses import LossWeights, restoration_loss
from ..restore.restorer import Restorer

WAVELENGTHS = 8
"""So many, evenly spaced, stand for all that a sensor sees."""
MIDDLE = 0.5  # of the distance between them


@dataclass(frozen=True)
class Optics:
    """The camera, whose mask may learn; its PSFs are `window` pixels wide."""

    camera: Camera
    window: int
    device: torch.device

    def with_height(self, height: Tensor | None) -> Optics:
        """The same with the height map [n, n] in metres of a step; None for a mask without relief."""
        return replace(self, camera=self.camera.with_height(height))

    def psfs(self, inverse_depths: Tensor) -> Tensor:
        """PSFs of the three colours, float32 [depth, band, window, window], inverse depths [depth] in 1/m."""
        bank = psf_bank(
            self.camera,
            PAPER_COLOURS,
            inverse_depths,
            window_px=self.window,
            device=self.device,
        )
        return bank.values.to(torch.float32)

    def mean_psfs(self, inverse_depths: Tensor, height_noise: float) -> Tensor:
        """The same for a height map whose samples err, see `optics.mean_psfs`."""
        return mean_psfs(
            self.camera,
            PAPER_COLOURS,
            inverse_depths,
            height_noise,
            window_px=self.window,
            device=self.device,
        )

    def mean_response_psfs(self, inverse_depths: Tensor, height_noise: float, shift: float = 0.0) -> Tensor:
        """`mean_psfs` of a few wavelengths, added up by the sensor's response, [depth, 3, window, window].

        shift: of these wavelengths, as a part of their distance, 0 to 1. Raises InputError for a sensor
        whose response is not tabulated.
        """
        wavelengths = self._response_wavelengths(shift)
        camera = self._sampled(wavelengths, inverse_depths)
        weights = response(camera, wavelengths)
        psf = mean_psfs(
            camera,
            wavelengths,
            inverse_depths,
            height_noise,
            window_px=self.window,
            device=self.device,
        )
        return torch.einsum("cb,dbyx->dcyx", weights.to(psf), psf)

    def response_psfs(self, inverse_depths: Tensor) -> Tensor:
        """`psfs` of a few wavelengths, added up by the sensor's response, [depth, 3, window, window]. Raises
        InputError as `mean_response_psfs`."""
        wavelengths = self._response_wavelengths(MIDDLE)
        camera = self._sampled(wavelengths, inverse_depths)
        bank = psf_bank(camera, wavelengths, inverse_depths, window_px=self.window, device=self.device).values
        weights = response(camera, wavelengths)
        return torch.einsum("cb,dbyx->dcyx", weights.to(bank), bank)

    def _response_wavelengths(self, shift: float) -> Tensor:
        curves = response_curves(self.camera)
        if curves is None:
            raise InputError("sensor.response: three lines have no other light; name a tabulated response")
        first, last = curves[0][0], curves[0][-1]
        return first + (last - first) * (torch.arange(WAVELENGTHS) + shift) / WAVELENGTHS

    def _sampled(self, wavelengths: Tensor, inverse_depths: Tensor) -> Camera:
        """The camera with its pupil sampled as finely as the shortest of wavelengths asks for."""
        recipe, fixed = self.camera.recipe, self.camera.recipe.psf.pupil_sampling_um
        if fixed == "auto":
            return self.camera

        def sampled(pitch: float | str) -> Camera:
            psf = recipe.psf.model_copy(update={"pupil_sampling_um": pitch})
            return replace(self.camera, recipe=recipe.model_copy(update={"psf": psf}))

        coarsest = coarsest_pitch(sampled("auto"), wavelengths, inverse_depths, self.window) * 1e6
        return self.camera if fixed <= coarsest else sampled(coarsest)


@dataclass(frozen=True)
class Captured:
    """clean, ideal: [batch, 3, y, x], the photo without noise and what it should show; truncated: scalar, the
    fraction of light that left the PSFs' window; psf: [batch, 3, window, window] where each scene has one;
    broadband: whether the sensor saw all wavelengths through its response, in place of three lines."""

    clean: Tensor
    ideal: Tensor
    truncated: Tensor
    psf: Tensor | None = None
    broadband: bool = False


def captured(
    clean: Tensor,
    ideal: Tensor,
    truncated: Tensor,
    psf: Tensor | None = None,
    *,
    saturates: bool,
    broadband: bool = False,
) -> Captured:
    """What lies beyond full scale is not asked of the network, and not seen by a sensor that saturates."""
    clean = clean.clamp_max(1) if saturates else clean
    return Captured(clean, ideal.clamp_max(1), truncated, psf, broadband)


class Scenes(Protocol):
    """A batch that can be photographed."""

    def photograph(self, optics: Optics) -> Captured:
        """The photo without noise, by the mask as it is made."""

    def reusing(self, psf: Tensor, broadband: bool) -> Scenes:
        """The same scenes with the PSFs of an earlier photo, and its light, where they can be used again."""


@dataclass(frozen=True)
class Planes:
    """Patches with their surroundings [batch, 3, y, x], each a plane at its inverse depth [batch]; psf: those
    of an earlier photo, [batch, 3, window, window], in place of the depths; mean: of the pictures that the
    patches are from, [batch, 3], None for the patches' own; saturates: whether the photo is clipped at full
    scale; broadband: see `Captured`."""

    sharp: Tensor
    inverse_depths: Tensor
    psf: Tensor | None = None
    mean: Tensor | None = None
    saturates: bool = False
    broadband: bool = False

    def photograph(self, optics: Optics) -> Captured:
        """Each colour sees one wavelength, as in the paper, or the same light of all that the sensor sees."""
        sharp = self.sharp.to(optics.device)
        psf = colour_psfs(optics, self.inverse_depths, self.broadband) if self.psf is None else self.psf
        before, after = surroundings(optics.window)
        ideal = sharp[..., before : sharp.shape[-2] - after, before : sharp.shape[-1] - after]
        mean = None if self.mean is None else self.mean.to(optics.device)
        truncated = 1 - psf.sum((-1, -2)).mean()
        how = {"saturates": self.saturates, "broadband": self.broadband}
        return captured(photograph(sharp, psf, mean), ideal, truncated, psf, **how)

    def reusing(self, psf: Tensor, broadband: bool) -> Scenes:
        return replace(self, psf=psf, broadband=broadband)


def colour_psfs(optics: Optics, inverse_depths: Tensor, broadband: bool) -> Tensor:
    """PSFs of the sensor's colours, [depth, 3, window, window], see `Captured`."""
    return optics.response_psfs(inverse_depths) if broadband else optics.psfs(inverse_depths)


class PooledCamera(Protocol):
    """One of many cameras that a network is trained over."""

    @property
    def optics(self) -> Optics: ...

    def tell(self, network: Restorer) -> None:
        """Condition the network on it."""

    def seen(self, network: Restorer, photo: Tensor, captured: Captured) -> Tensor:
        """What the network is given of a photo [batch, 3, y, x], [batch, channel, y, x]."""


@dataclass(frozen=True)
class Draw:
    """All that is random in a step. read_noise: [batch], standard deviations relative to full scale;
    generator: for the noise itself, on the device of the photo; camera: that takes the photo in place of the
    system's."""

    scenes: Scenes
    read_noise: Tensor
    generator: torch.Generator
    camera: PooledCamera | None = None


@dataclass(frozen=True)
class JudgedPhotos:
    """loss: scalar with its graph; photo, restored, ideal: [batch, 3, y, x]; psf, broadband: see
    `Captured`."""

    loss: Tensor
    photo: Tensor
    restored: Tensor
    ideal: Tensor
    psf: Tensor | None
    broadband: bool


class System(nn.Module):
    """mask() gives a height map [n, n] in metres, or None for a mask without relief; network restores.

    truncated_energy: weight of the light that leaves the PSFs' window. height_noise: standard deviation in
    metres, added anew to each sample of the height map in every step, for the errors of fabrication.
    depth_range: least and largest inverse depth in 1/m. bfloat16 applies to the network alone: the
    optics stay in float32. light_kept: see `recipe.train.LossTable`.
    """

    def __init__(
        self,
        optics: Optics,
        mask: nn.Module,
        network: Restorer,
        loss: LossWeights,
        truncated_energy: float,
        height_noise: float,
        depth_range: tuple[float, float],
        bfloat16: bool = False,
        light_kept: bool = False,
    ) -> None:
        super().__init__()
        self.depth_range, self.truncated_energy = depth_range, truncated_energy
        self.optics, self.loss_weights = optics, loss
        self.height_noise, self.in_bfloat16, self.light_kept = height_noise, bfloat16, light_kept
        self.mask, self.network = mask, network
        self._known: dict[bool, object] = {}

    def forward(self, draw: Draw) -> JudgedPhotos:
        """A photo of the drawn scenes, restored and judged."""
        height = self.mask()
        if draw.camera is None:
            captured = self.capture(draw, height)
            self.tell(captured.broadband)
        else:
            captured = draw.scenes.photograph(draw.camera.optics)
            draw.camera.tell(self.network)
        photo = _noisy(captured.clean, draw)
        seen = photo if draw.camera is None else draw.camera.seen(self.network, photo, captured)
        restored = self.restore(seen, height)
        # what is shown ends at full scale, as the truth does
        restored = torch.where(captured.ideal < 1, restored, restored.clamp_max(1))
        if self.light_kept:
            restored = keep_light(captured.ideal, restored)
        photo, restored, ideal = (self._inside(image) for image in (photo, restored, captured.ideal))
        loss = restoration_loss(restored, ideal, self.loss_weights)
        loss = loss + self.truncated_energy * captured.truncated
        psf = None if captured.psf is None else captured.psf.detach()
        return JudgedPhotos(loss, photo, restored, ideal, psf, captured.broadband)

    def _inside(self, image: Tensor) -> Tensor:
        """Without the border that the network cannot know, where a patch is wide enough."""
        border = self.network.border
        if border == 0 or min(image.shape[-2:]) <= 3 * border:
            return image
        return image[..., border:-border, border:-border]

    def capture(self, draw: Draw, height: Tensor | None) -> Captured:
        """The drawn scenes by the mask `height` [n, n] as it is made: with errors of fabrication."""
        if height is not None and self.height_noise > 0:
            height = height + self.height_noise * _normal(height, draw.generator)
        return draw.scenes.photograph(self.optics.with_height(height))

    def restore(self, photo: Tensor, height: Tensor | None) -> Tensor:
        """What the network sees to [batch, 3, y, x], float32."""
        if self.network.psfs == "designed":
            return self.network.restored_with(photo, self._designed_psfs(height))
        photo = photo.contiguous(memory_format=torch.channels_last)
        restore = self.network.unclamped if self.light_kept else self.network
        with torch.autocast(photo.device.type, torch.bfloat16, enabled=self.in_bfloat16):
            return restore(photo).to(torch.float32)

    def prime(self) -> None:
        """Give a network that is conditioned on the optics the PSFs of the mask as it is, made with the mean
        error of fabrication."""
        if self.network.psfs == "mean" and not self.network.any_camera:
            self.network.set_psfs(self._mean_psfs(broadband=False))

    @torch.no_grad()
    def _mean_psfs(self, broadband: bool) -> Tensor:
        depths = self.network.psf_depths(self.depth_range)
        height = self.mask()
        optics = self.optics.with_height(height)
        if height is None:
            return colour_psfs(optics, depths, broadband)
        if broadband:  # of the wavelengths that photos are made of
            return optics.mean_response_psfs(depths, self.height_noise, MIDDLE)
        return optics.mean_psfs(depths, self.height_noise)

    def tell(self, broadband: bool) -> None:
        """Condition the network on the light that the sensor sees, where some of it is broadband. What is
        saved knows three lines."""
        if self.network.psfs != "mean" or self.network.any_camera or not (broadband or self._known):
            return
        if not self._known:
            self._known[False] = self.network.known()
        if broadband not in self._known:
            self.network.set_psfs(self._mean_psfs(broadband))
            self._known[broadband] = self.network.known()
        self.network.use(self._known[broadband])

    def settle(self) -> None:
        """Give a network that restores by the PSFs of each step those of the mask as it is now, for its
        checkpoint, and one that is conditioned on them those of the three colours."""
        self.tell(broadband=False)
        if self.network.psfs == "designed":
            with torch.no_grad():
                self.network.set_psfs(self._designed_psfs(self.mask()))

    def _designed_psfs(self, height: Tensor | None) -> Tensor:
        return self.optics.with_height(height).psfs(self.network.psf_depths(self.depth_range))


def _noisy(clean: Tensor, draw: Draw) -> Tensor:
    noise = draw.read_noise.to(clean)[:, None, None, None]
    return clean + noise * _normal(clean, draw.generator)


def _normal(like: Tensor, generator: torch.Generator) -> Tensor:
    where = generator.device
    return torch.randn(like.shape, generator=generator, dtype=like.dtype, device=where).to(like.device)
