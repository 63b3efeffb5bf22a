"""What restores photos in an experiment: a network, Wiener deconvolution, or a function of the user's own."""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from torch import Tensor

from ..capture.sensor import noise_deviation
from ..errors import InputError
from ..optics import Camera
from ..optics.nodes import nodes_between
from ..restore import WIENER, channel_psfs, refusal, restore, wiener_by_depth
from ..restore.checkpoint import Checkpoint, find_checkpoint, load_checkpoint
from ..restore.functions import OwnFunction, PhotoInfo, load_function, names_function
from ..restore.light import without_glare

WIENER_OF_DEPTH = "wiener-depth"
"""In place of a checkpoint: Wiener deconvolution that knows the distance of each pixel."""


@dataclass(frozen=True)
class Known:
    """What is known of a photo.

    camera: as it is designed.
    wavelengths: [band] in metres.
    ends: the least and the largest inverse depth in 1/m, [2].
    glare: [channel], part of the light that is spread evenly by the mask as it is made.
    inverse_depth: [y, x] in 1/m, the true distances.
    nodes: gives inverse depths that stand for the range, [depth], and `channel_psfs` of these.
    truncated: [channel], None where the light that leaves the PSFs' windows is not in `glare`.
    """

    camera: Camera
    wavelengths: Tensor
    ends: Tensor
    glare: Tensor
    inverse_depth: Tensor
    nodes: Callable[[], tuple[Tensor, Tensor]]
    truncated: Tensor | None = None

    def within(self) -> tuple[Tensor, Tensor]:
        """The nodes, and their PSFs without the part of the light that `glare` holds already."""
        depths, psfs = self.nodes()
        return depths, psfs if self.truncated is None else psfs / psfs.sum((-1, -2), keepdim=True)


def known_of(
    camera: Camera,
    wavelengths: Tensor,
    ends: Tensor,
    glare: Tensor,
    inverse_depth: Tensor,
    truncated: Tensor | None = None,
) -> Known:
    """The same with the nodes that the camera asks for, found once, where they are asked for.

    wavelengths: [band], metres.
    ends: [2], least and largest inverse depth, 1/m.
    glare: [channel], part of the light.
    inverse_depth: [y, x], 1/m.
    truncated: [channel], part of the light.
    """

    @functools.cache
    def nodes() -> tuple[Tensor, Tensor]:
        depths = nodes_between(camera, wavelengths, *ends)
        return depths, channel_psfs(camera, wavelengths, depths)

    return Known(camera, wavelengths, ends, glare, inverse_depth, nodes, truncated)


class Restoration(Protocol):
    """Restores photos [channel, y, x] to images of that shape.

    name: in figures.
    digest: of what it is.
    """

    @property
    def name(self) -> str: ...

    @property
    def digest(self) -> str: ...

    def __call__(self, photo: Tensor, known: Known) -> Tensor: ...


@dataclass(frozen=True)
class ByWiener:
    """Wiener deconvolution for depths that are equally likely."""

    name: str = WIENER
    digest: str = WIENER

    def __call__(self, photo: Tensor, known: Known) -> Tensor:
        depths, psfs = known.within()
        return restore(photo, known.camera, known.wavelengths, depths, psfs=psfs, glare=known.glare)[0]


@dataclass(frozen=True)
class AsItIs:
    """The photo, left as it is."""

    name: str = "photo"
    digest: str = "photo"

    def __call__(self, photo: Tensor, known: Known) -> Tensor:
        return photo.clone()


@dataclass(frozen=True)
class ByWienerOfDepth:
    """Wiener deconvolution of each pixel for its true distance, which no photo tells. Raises InputError for a
    lens that varies over the field."""

    name: str = WIENER_OF_DEPTH
    digest: str = WIENER_OF_DEPTH

    def __call__(self, photo: Tensor, known: Known) -> Tensor:
        if known.camera.lens.varies:
            raise InputError(
                f"{self.name} restores by the PSFs of the optical axis alone, and those of"
                f" {known.camera.recipe.name} change over the frame: take `wiener`, which has those of each"
                " place"
            )
        depths, psfs = known.within()
        light, noise = without_glare(photo, known.glare), noise_deviation(known.camera)
        return wiener_by_depth(light, psfs.to(photo), depths, known.inverse_depth, noise)


@dataclass(frozen=True)
class ByNetwork:
    """The network of a checkpoint."""

    checkpoint: Checkpoint
    digest: str

    @classmethod
    def of(cls, source: str | Path) -> ByNetwork:
        """The network of a checkpoint, file or shipped name. Raises InputError."""
        return cls(load_checkpoint(source), digest_of(source))

    @property
    def name(self) -> str:
        return self.checkpoint.name

    @property
    def any_camera(self) -> bool:
        return self.checkpoint.network.any_camera

    def __call__(self, photo: Tensor, known: Known) -> Tensor:
        if why := refusal(self.checkpoint, known.camera):
            raise InputError(f"{why}; take a narrower psf.window_px, or `wiener`")
        depths, psfs = known.nodes() if self.any_camera else (known.ends, None)
        how = {"checkpoint": self.checkpoint, "glare": known.glare, "truncated": known.truncated}
        return restore(photo, known.camera, known.wavelengths, depths, psfs=psfs, **how)[0]


@dataclass(frozen=True)
class ByFunction:
    """A Python function; see `restore.functions`."""

    function: OwnFunction

    @property
    def name(self) -> str:
        return self.function.name

    @property
    def digest(self) -> str:
        return self.function.digest

    def __call__(self, photo: Tensor, known: Known) -> Tensor:
        depths, psfs = known.nodes()
        info = PhotoInfo(
            camera=known.camera,
            wavelengths=known.wavelengths,
            inverse_depths=depths,
            noise=noise_deviation(known.camera),
            glare=known.glare,
            inverse_depth=known.inverse_depth,
        )
        return self.function(photo, psfs, info)


WITHOUT_WEIGHTS: Mapping[str, Restoration] = {
    each.name: each for each in (ByWiener(), ByWienerOfDepth(), AsItIs())
}


def restoration(source: str) -> Restoration:
    """`wiener`, `wiener-depth`, `photo` (which leaves it as it is), a checkpoint (file or shipped name), or a
    function, `module:function` or `file.py:function`. Raises InputError for anything else."""
    if source in WITHOUT_WEIGHTS:
        return WITHOUT_WEIGHTS[source]
    if names_function(source):
        return ByFunction(load_function(source))
    return ByNetwork.of(source)


def digest_of(source: str | Path) -> str:
    """SHA-256 of a checkpoint's file."""
    return hashlib.sha256(find_checkpoint(source).read_bytes()).hexdigest()
