"""Photos written out once more, as the truth of hard photos: each fragment's own PSF, sums of plain
convolutions in float64, depth by depth and band by band. No layers, transforms, tiles or batches, and no code
of `capture`. PSFs and response are those of the camera (`OWN`), or come from elsewhere (`Source`).

All photos are [channel, y, x] of the frame, unexposed. What leaves a PSF's window is veiling glare: its mean
over the padded frame. Fragments block as if their PSFs held all light.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.signal import convolve2d
from torch import Tensor

from ..optics import Camera, psf_bank, response
from ..render.view import View

Array = NDArray[np.float64]
Layer = tuple[Array, Array]
"""Blurred light and coverage, [channel, y, x] each of the padded frame."""
ENOUGH = 1e-3
"""Coverage behind a hole below which nothing is there to fill it with."""
AT_ONCE = 16
"""Depths whose PSFs are asked for together."""


@dataclass(frozen=True)
class Source:
    """Where a photo that is written out has its numbers from.

    psfs: of a camera at a wavelength in nm, a window and inverse depths [1/m], a PSF [y, x] each.
    response: [channel, band] for wavelengths in nm.
    """

    psfs: Callable[[Camera, float, int, Sequence[float]], Sequence[Array]]
    response: Callable[[Camera, Sequence[float]], Array]


def _psfs(camera: Camera, nanometres: float, window: int, inverse_depths: Sequence[float]) -> list[Array]:
    made = psf_bank(camera, [nanometres * 1e-9], list(inverse_depths), window_px=window, dtype=torch.float64)
    return list(made.values[:, 0].detach().numpy())


def _response(camera: Camera, nanometres: Sequence[float]) -> Array:
    found: Array = response(camera, torch.tensor(nanometres, dtype=torch.float64) * 1e-9).numpy()
    return found


OWN = Source(_psfs, _response)
"""The camera's own PSFs, one for each depth in float64, and its response."""


class Scene:
    """A view as numbers, and the camera that sees it."""

    def __init__(self, view: View, camera: Camera, window: int | None = None, source: Source = OWN) -> None:
        self.view, self.camera, self.source = view, camera, source
        self.shape = view.padded_shape
        self.window = window or camera.recipe.psf.window_px
        self.nanometres = [round(float(each) * 1e9, 6) for each in view.wavelengths]
        self.response = source.response(camera, self.nanometres)
        self.pixel = view.pixel.numpy()
        self.depth: Array = view.inverse_depth.double().numpy()
        self.coverage: Array = view.coverage.double().numpy()
        self.radiance: Array = view.radiance.detach().double().numpy()
        self.seen: NDArray[np.bool_] = ~view.hidden.numpy()
        self._known: dict[tuple[int, float], Array] = {}
        for band in range(len(self.nanometres)):
            self._prepare(band, np.unique(self.depth).tolist())

    def _prepare(self, band: int, inverse_depths: Sequence[float]) -> None:
        """Compute the PSFs that are not known yet."""
        new = [each for each in inverse_depths if (band, each) not in self._known]
        for start in range(0, len(new), AT_ONCE):
            some = new[start : start + AT_ONCE]
            found = self.source.psfs(self.camera, self.nanometres[band], self.window, some)
            self._known |= {(band, each): psf for each, psf in zip(some, found, strict=True)}

    def psf(self, band: int, inverse_depth: float) -> Array:
        self._prepare(band, [float(inverse_depth)])
        return self._known[band, float(inverse_depth)]

    def light(self, which: NDArray[np.bool_], depth: Array | None = None) -> Array:
        """Blurred light of fragments, [channel, y, x] of the padded frame.

        depth: in place of their own.
        """
        depth = self.depth if depth is None else depth
        total = np.zeros((3, *self.shape))
        for each in np.unique(depth[which]):
            here = which & (depth == each)
            for band in range(len(self.nanometres)):
                image = self._blurred(self._image(self.radiance[band, here], here), self.psf(band, each))
                total += self.response[:, band, None, None] * image
        return total

    def blocked(self, which: NDArray[np.bool_], depth: Array | None = None) -> Array:
        """Blurred coverage of fragments, likewise."""
        depth = self.depth if depth is None else depth
        total = np.zeros((3, *self.shape))
        for each in np.unique(depth[which]):
            here = which & (depth == each)
            cover = self._image(self.coverage[here], here)
            for band in range(len(self.nanometres)):
                psf = self.psf(band, each)
                total += self.response[:, band, None, None] * self._blurred(cover, psf / psf.sum())
        return total

    def layer(self, which: NDArray[np.bool_], depth: Array | None = None) -> Layer:
        return self.light(which, depth), self.blocked(which, depth)

    def glare(self) -> Array:
        """Mean of the visible light beyond the windows: [channel, 1, 1]."""
        total = np.zeros(3)
        for each in np.unique(self.depth[self.seen]):
            here = self.seen & (self.depth == each)
            for band in range(len(self.nanometres)):
                lost = 1 - self.psf(band, each).sum()
                total += self.response[:, band] * lost * self.radiance[band, here].sum()
        return total[:, None, None] / (self.shape[0] * self.shape[1])

    def frame(self, image: Array) -> Tensor:
        margin = self.view.margin
        rows, columns = self.shape
        inside = image[:, margin : rows - margin, margin : columns - margin]
        return torch.from_numpy(np.ascontiguousarray(inside))

    def _image(self, amount: Array, here: NDArray[np.bool_]) -> Array:
        total = np.bincount(self.pixel[here], amount, self.shape[0] * self.shape[1])
        return np.asarray(total, np.float64).reshape(self.shape)

    def _blurred(self, image: Array, psf: Array) -> Array:
        if not image.any():
            return np.zeros(self.shape)
        rows, columns = self.shape
        centre = self.window // 2
        whole = convolve2d(image, psf)
        found: Array = whole[centre : centre + rows, centre : centre + columns]
        return found


def linear(view: View, camera: Camera, source: Source = OWN) -> Tensor:
    """Nothing hides anything: the sum of all that is seen."""
    scene = Scene(view, camera, source=source)
    return scene.frame(scene.light(scene.seen) + scene.glare())


def _snapped(scene: Scene, nodes: Sequence[float]) -> Iterator[Layer]:
    """Layers of what is seen, each fragment at its nearest node, near to far."""
    at = np.asarray(nodes)
    nearest = at[np.abs(scene.depth[:, None] - at).argmin(1)]
    for node in at[::-1]:
        which = scene.seen & (nearest == node)
        if which.any():
            yield scene.layer(which, nearest)


def over(view: View, camera: Camera, nodes: Sequence[float], source: Source = OWN) -> Tensor:
    """Layers at the nodes [1/m], each dimmed by the blurred coverage of those in front: Porter and Duff's
    operator (Computer Graphics 18, 253, 1984)."""
    scene = Scene(view, camera, source=source)
    photo, clear = np.zeros((3, *scene.shape)), np.ones((3, *scene.shape))
    for light, blocked in _snapped(scene, nodes):
        photo += clear * light
        clear *= np.clip(1 - blocked, 0, 1)
    return scene.frame(photo + _glare_at(scene, nodes))


def normalised(view: View, camera: Camera, nodes: Sequence[float], source: Source = OWN) -> Tensor:
    """The same with light and coverage divided by the blurred coverage of the layer and all behind it: Ikoma
    et al. 2021, Eq. 4."""
    scene = Scene(view, camera, source=source)
    layers = list(_snapped(scene, nodes))
    photo, clear = np.zeros((3, *scene.shape)), np.ones((3, *scene.shape))
    for number, (light, blocked) in enumerate(layers):
        behind = sum((each for _, each in layers[number + 1 :]), blocked)
        there = np.maximum(behind, 1e-4)
        photo += clear * light / there
        clear *= np.clip(1 - blocked / there, 0, 1)
    return scene.frame(photo + _glare_at(scene, nodes))


def uncovered(view: View, camera: Camera, cut: float | None, source: Source = OWN) -> Tensor:
    """Two surfaces, one nearer than the inverse depth `cut`, and the far one also where it is hidden; where
    its fragments do not have, light from their surroundings fills them.

    cut: None for nothing that hides anything.
    """
    if cut is None:
        return linear(view, camera, source)
    scene = Scene(view, camera, source=source)
    near = scene.depth > cut
    light, blocked = scene.layer(near)
    behind, there = scene.layer(~near)
    known = np.where(there > ENOUGH, np.clip(there, 0, 1), 1.0)
    return scene.frame(light + (1 - np.clip(blocked, 0, 1)) * behind / known + scene.glare())


def _glare_at(scene: Scene, nodes: Sequence[float]) -> Array:
    """The glare between the nodes: what lies between two of them is shared by both."""
    at = np.asarray(nodes, dtype=np.float64)
    total = np.zeros(3)
    for band in range(len(scene.nanometres)):
        lost = np.array([1 - scene.psf(band, node).sum() for node in at])
        share = np.interp(scene.depth[scene.seen], at, lost)
        total += scene.response[:, band] * float((share * scene.radiance[band, scene.seen]).sum())
    return total[:, None, None] / (scene.shape[0] * scene.shape[1])
