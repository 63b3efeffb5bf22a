"""Photos written out once more, as the truth of hard photos: each fragment's own PSF (`written_out`), sums of
plain convolutions in float64, depth by depth and band by band. No layers, transforms, tiles or batches, and
no code of `optics` or `capture`.

All photos are [channel, y, x] of the frame, unexposed. What leaves a PSF's window is veiling glare: its mean
over the padded frame. Fragments block as if their PSFs held all light.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import lru_cache
from hashlib import sha256

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.signal import convolve2d
from torch import Tensor

from ..optics import Camera
from ..optics.levin import PATTERN
from ..optics.masks.coded import CodedMask
from ..optics.masks.cubic import CubicMask
from ..recipe.camera import CameraRecipe
from ..render.view import View
from .written_out import Array, Psfs, Pupil, coded, cubic, relief, sensor_response

Layer = tuple[Array, Array]
"""Blurred light and coverage, [channel, y, x] each of the padded frame."""
ENOUGH = 1e-3
"""Coverage behind a hole below which nothing is there to fill it with."""
_pupils: dict[str, Pupil] = {}


def pupil_of(recipe: CameraRecipe, height: Tensor | None = None) -> Pupil:
    """The pupil of a recipe with the paper's lens and one of the masks of `views.MASKS`; height: the free
    map."""
    mask = recipe.mask
    named = f"{recipe.lens.model_dump_json()} {mask.model_dump_json()}"
    if height is not None:
        named += sha256(height.detach().double().numpy().tobytes()).hexdigest()
    if named not in _pupils:
        lens = recipe.lens.model_dump()
        radius = lens["aperture_radius_mm"] * 1e-3
        if height is not None:
            _pupils[named] = relief(radius, height.detach().double().numpy(), 2 * radius / len(height))
        elif isinstance(mask, CubicMask):
            _pupils[named] = cubic(radius, mask.alpha_rad)
        elif isinstance(mask, CodedMask):
            _pupils[named] = coded(radius, PATTERN)
        else:
            _pupils[named] = Pupil(radius, spherical=lens["surface_profile"] == "spherical")
    return _pupils[named]


@lru_cache(maxsize=12)
def _psfs(pupil: Pupil, nanometres: float, window: int) -> Psfs:
    points = 3 if pupil.radius < 1e-3 else 6
    return Psfs(pupil, nanometres * 1e-9, window, points)


_known: dict[tuple[Pupil, float, int, float], Array] = {}
"""PSFs by pupil, wavelength, window and inverse depth."""
AT_ONCE = 16


def _prepare(pupil: Pupil, nanometres: float, window: int, inverse_depths: Sequence[float]) -> None:
    """Compute the PSFs that are not known yet."""
    new = [each for each in inverse_depths if (pupil, nanometres, window, each) not in _known]
    for start in range(0, len(new), AT_ONCE):
        some = new[start : start + AT_ONCE]
        for each, psf in zip(some, _psfs(pupil, nanometres, window).at(some), strict=True):
            _known[pupil, nanometres, window, each] = psf


class Scene:
    """A view as numbers, and the camera that sees it."""

    def __init__(self, view: View, camera: Camera, window: int | None = None) -> None:
        self.view = view
        self.shape = view.padded_shape
        self.window = window or camera.recipe.psf.window_px
        self.pupil = pupil_of(camera.recipe, camera.height_map)
        self.nanometres = [round(float(each) * 1e9, 6) for each in view.wavelengths]
        self.response = sensor_response(self.nanometres)
        self.pixel = view.pixel.numpy()
        self.depth: Array = view.inverse_depth.double().numpy()
        self.coverage: Array = view.coverage.double().numpy()
        self.radiance: Array = view.radiance.detach().double().numpy()
        self.seen: NDArray[np.bool_] = ~view.hidden.numpy()
        for nanometres in self.nanometres:
            _prepare(self.pupil, nanometres, self.window, np.unique(self.depth).tolist())

    def psf(self, band: int, inverse_depth: float) -> Array:
        at = float(inverse_depth)
        _prepare(self.pupil, self.nanometres[band], self.window, [at])
        return _known[self.pupil, self.nanometres[band], self.window, at]

    def light(self, which: NDArray[np.bool_], depth: Array | None = None) -> Array:
        """Blurred light of fragments, [channel, y, x] of the padded frame. depth: in place of their own."""
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


def linear(view: View, camera: Camera) -> Tensor:
    """Nothing hides anything: the sum of all that is seen."""
    scene = Scene(view, camera)
    return scene.frame(scene.light(scene.seen) + scene.glare())


def _snapped(scene: Scene, nodes: Sequence[float]) -> Iterator[Layer]:
    """Layers of what is seen, each fragment at its nearest node, near to far."""
    at = np.asarray(nodes)
    nearest = at[np.abs(scene.depth[:, None] - at).argmin(1)]
    for node in at[::-1]:
        which = scene.seen & (nearest == node)
        if which.any():
            yield scene.layer(which, nearest)


def over(view: View, camera: Camera, nodes: Sequence[float]) -> Tensor:
    """Layers at the nodes [1/m], each dimmed by the blurred coverage of those in front: Porter and Duff's
    operator (Computer Graphics 18, 253, 1984)."""
    scene = Scene(view, camera)
    photo, clear = np.zeros((3, *scene.shape)), np.ones((3, *scene.shape))
    for light, blocked in _snapped(scene, nodes):
        photo += clear * light
        clear *= np.clip(1 - blocked, 0, 1)
    return scene.frame(photo + _glare_at(scene, nodes))


def normalised(view: View, camera: Camera, nodes: Sequence[float]) -> Tensor:
    """The same with light and coverage divided by the blurred coverage of the layer and all behind it: Ikoma
    et al. 2021, Eq. 4."""
    scene = Scene(view, camera)
    layers = list(_snapped(scene, nodes))
    photo, clear = np.zeros((3, *scene.shape)), np.ones((3, *scene.shape))
    for number, (light, blocked) in enumerate(layers):
        behind = sum((each for _, each in layers[number + 1 :]), blocked)
        there = np.maximum(behind, 1e-4)
        photo += clear * light / there
        clear *= np.clip(1 - blocked / there, 0, 1)
    return scene.frame(photo + _glare_at(scene, nodes))


def uncovered(view: View, camera: Camera, cut: float | None) -> Tensor:
    """Two surfaces, one nearer than the inverse depth `cut`, and the far one also where it is hidden; where
    its fragments do not have, light from beside fills them. cut: None for nothing that hides anything."""
    if cut is None:
        return linear(view, camera)
    scene = Scene(view, camera)
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
