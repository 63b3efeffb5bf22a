"""What every network for restoring photos is asked for: a new one is a class that says where it differs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar, Literal

from torch import Tensor, nn

from ..errors import InputError
from .linear import local_error


class Restorer(nn.Module):
    """Maps a photo [batch, 3, y, x], full scale 1, to the sharp image of the same shape: `forward` is that.

    kind: the name that recipes and checkpoints know it by.
    radius: how far in pixels an output pixel sees at most; None: all of the photo.
    multiple: photos are padded to a multiple of this many pixels.
    border: this many outermost pixels should not be judged in training.
    groups: parts of the depth range that it restores each by a filter of its own.

    psfs: which PSFs it is conditioned on (`set_psfs`). "mean": once before a training, those of the mask with
        the mean error of its making, and again for a camera whose response is another. "designed": in each
        step of a training, those of the mask as it is then, so that gradients reach the mask through them;
        the last ones are kept.

    colour_psfs: whether it wants, of broadband light, what each channel sees of each colour (`set_psfs`).
    psf_buffers: names of its buffers that `set_psfs` fills.

    glare: of each colour, the part of the light that was spread evenly over the photos that it was trained
        on, by the errors of its mask's making; None: not known. Photos are given as much before it sees them:
        one without would have more contrast than it knows.

    any_camera: it was trained over many cameras, and is set for each new one (`set_camera`).
    sees_linear: its photos have three more channels, what Wiener deconvolution makes of the photo.
    """

    kind: ClassVar[str]
    psfs: Literal["none", "mean", "designed"] = "none"
    colour_psfs: bool = False
    psf_buffers: ClassVar[tuple[str, ...]] = ()
    any_camera: ClassVar[bool] = False
    sees_linear: bool = False
    radius: int | None = None
    multiple: int = 1
    border: int = 0
    groups: int = 1
    glare: tuple[float, ...] | None = None

    @classmethod
    def settings_for(cls, settings: Mapping[str, object], window_px: int) -> dict[str, object]:
        """A recipe's settings, with what follows from the width of its PSFs' window where they do not say."""
        return dict(settings)

    def settings(self) -> dict[str, object]:
        """What rebuilds this network: the arguments of its class, as JSON values."""
        return {}

    def psf_depths(self, depth_range: tuple[float, float]) -> Tensor:
        """Inverse depths that it wants the PSFs of, float64 [depth], within a range, both in 1/m.

        depth_range: least and largest inverse depth, 1/m.
        """
        raise NotImplementedError

    def set_psfs(self, psf: Tensor) -> None:
        """Give it the PSFs at `psf_depths`, to keep in its checkpoint.

        psf: [depth, 3, y, x]; with `colour_psfs` also [depth, channel, colour, y, x].
        """
        raise NotImplementedError

    def psf_state(self) -> object:
        """What it was given by `set_psfs`, for `load_psf_state`."""
        return tuple(getattr(self, name) for name in self.psf_buffers)

    def load_psf_state(self, known: object) -> None:
        """Condition the network on that state.

        known: what `psf_state` gave.
        """
        assert isinstance(known, tuple)
        for name, value in zip(self.psf_buffers, known, strict=True):
            setattr(self, name, value)

    def set_camera(self, psf: Tensor, noise: float) -> None:
        """Give it the PSFs of a camera at `psf_depths`, and its noise, where `any_camera`.

        psf: [depth, 3, y, x].
        noise: standard deviation, relative to full scale.
        """
        raise NotImplementedError

    def camera_state(self) -> Sequence[Tensor]:
        """What it was given by `set_camera`, for `load_camera_state` in another process; none: it is not
        kept."""
        return ()

    def load_camera_state(self, known: Sequence[Tensor]) -> None:
        """Set it for that camera.

        known: what `camera_state` gave.
        """
        raise NotImplementedError

    def linear_share(self) -> float:
        """How much of what restores a photo is Wiener deconvolution's, for the camera that it was set for,
        where `any_camera`."""
        return 0.0

    def brightened_for(self, photo: Tensor) -> tuple[Restorer, float]:
        """What restores a photo [3, y, x] of so little light, given the same camera, and the factor by which
        the photo is brightened for it; what it restores is darkened by as much.

        photo: [3, y, x], full scale 1.
        """
        return self, 1.0

    @classmethod
    def grown(cls, network: Restorer, settings: Mapping[str, object] | None = None) -> Restorer:
        """One with the weights of a network of another kind, or of its own with other settings.

        settings: in place of that network's.

        Raises InputError where that cannot be.
        """
        raise InputError(f"a network {cls.kind!r} cannot start from a {network.kind!r}")

    def with_auxiliary(self, network: Restorer) -> Restorer:
        """The same network, which also sees the photo as another network restores it. Raises
        InputError where that cannot be.

        network: the other one, of the same mask.
        """
        raise InputError(f"a network {self.kind!r} takes no auxiliary network; remove network.auxiliary")

    def unclamped(self, photo: Tensor) -> Tensor:
        """The sharp image as `forward` gives it in use, before it is clamped to [0, 1]: what lies beyond may
        still be moved (see `light`).

        photo: [batch, 3, y, x], full scale 1.
        """
        return self(photo)

    def restored_with(self, photo: Tensor, psf: Tensor) -> Tensor:
        """The sharp image by PSFs [depth, 3, y, x] that gradients go through, where `psfs` is "designed".

        photo: [batch, 3, y, x], full scale 1.
        psf: [depth, 3, y, x].
        """
        raise NotImplementedError

    def linear_error(self, psf: Tensor, filters: int) -> Tensor:
        """Mean square error, [depth, 3], that the linear restoration most like this network leaves with so
        many filters of photos with PSFs [depth, 3, y, x]: what a mask is designed by (see `linear`).

        psf: [depth, 3, y, x].
        filters: how many.
        """
        return local_error(psf, groups=filters)
