"""The clipped pupil: each fragment seen through that part of the pupil to which nothing blocks its light.

A point's photo is |F{Q V}|^2 with Q the generalised pupil function (Akpinar et al., Eq. `Q`) and V the light
of the point in the pupil: the shadow of what stands in the way, as rays draw it, with the diffraction at its
edges. Without that, light would bend at edges in the pupil instead of where they are, and a white room would
not look white. The photo of a scene is the sum over points, which are incoherent. Any mask; slow: one
transform for each fragment and band that is seen in part.

Of what it judges it takes the pupil and the PSFs of points that the whole pupil sees, and nothing that blurs
light or says what is hidden.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import Tensor

from ..capture.checks import check_pixel_angle
from ..capture.crop import crop as cropped
from ..capture.prepare import channel_weights
from ..core.progress import Progress, silent
from ..errors import InputError
from ..optics import Camera, defocus, plan_sampling, psf_bank
from ..optics.pupil import aperture, bent, pupil_function
from ..render.engine import use_engine
from ..render.translate import build_stage
from ..render.view import View
from ..scene.model import SceneModel
from .clipped_psf import clipped_psf, make_transform, shadow
from .pinhole import Crop, pixel_directions
from .visibility import PLACES, first_hits, places_of, pupil_points, visible

if TYPE_CHECKING:
    import mitsuba as mi

RAYS = 64
"""Pupil points across a square of twice the pupil's diameter."""
DEFOCUS_STEP = 1.5
"""Nodes for the fragments that the whole pupil sees, in radians of Psi: interpolation errs below 60 dB."""
SPAN = 2.0
"""Half-width of the square that is looked at, in pupil radii: shadows beyond the rim bend light into it."""
RAY_ROUNDS = 4
"""Places at which a fragment that fills its pixel in part is looked at from the pupil."""
NEAR = 1.3
"""Shadows that come no nearer to the centre than this, in pupil radii, are left out: Fresnel's fringes of an
edge half a millimetre outside the paper's pupil change its rim by a tenth."""
SLOPE = 0.03
"""Largest change of inverse depth within a pixel, in 1/m, that is taken for a slope of one surface."""
BATCH = 16
FULL = 0.999
"""A fragment of less coverage lies somewhere in its pixel, not all over it."""


def clipped_pupil(
    view: View,
    model: SceneModel,
    camera: Camera,
    where: Crop,
    *,
    response: Tensor | None = None,
    window_px: int | None = None,
    rays: int = RAYS,
    cache: Path | None = None,
    device: str = "auto",
    progress: Progress | None = None,
) -> Tensor:
    """Noise-free, unexposed photo of a part of the frame: [channel, y, x], float64.

    view: of the scene `model`, through a pinhole.
    where: small, for each fragment within a PSF's reach that is seen in part costs a transform a band.
    response: of the channels to the view's bands [channel, band]; None for the camera's.
    rays: across a square of twice the pupil's diameter.

    The light is the view's own: its noise is in this image too, and what differs in a photo is blur and
    occlusion. Raises InputError for a crop outside the frame, EngineError where no rays can be traced.
    """
    settings = dict(window_px=window_px, rays=rays, cache=cache, device=device, progress=progress)
    responses = None if response is None else [response]
    return clipped_pupils(view, model, [camera], where, responses=responses, **settings)[0]


def clipped_pupils(
    view: View,
    model: SceneModel,
    cameras: Sequence[Camera],
    where: Crop,
    *,
    responses: Sequence[Tensor] | None = None,
    window_px: int | None = None,
    rays: int = RAYS,
    cache: Path | None = None,
    device: str = "auto",
    progress: Progress | None = None,
) -> list[Tensor]:
    """`clipped_pupil` for several cameras of one aperture and pixel angle, which share rays and shadows.

    responses: [channel, band] each.

    Raises InputError for cameras of different apertures.
    """
    say = progress or silent
    check_crop(view, where)
    first = cameras[0]
    for camera in cameras:
        check_pixel_angle(view, camera.pixel_angle)
        if camera.aperture_radius != first.aperture_radius:
            raise InputError("cameras of different apertures see different shadows: take them one by one")
    window = window_px or first.recipe.psf.window_px
    reach = window // 2
    part = cropped(view, where.top, where.left, where.height, where.width, reach).to(dtype=torch.float64)
    say(0.0, "loading the scene")
    seen, nearer = _visibility(part, view, model, first, where, reach, rays, device, say)
    inside = _near_the_pupil(rays, first.aperture_radius)
    whole = torch.from_numpy((seen[:, inside] == 1).all(1))
    none = torch.from_numpy(~seen[:, inside].any(1))
    some = torch.nonzero(~whole & ~none).squeeze(1)
    say(0.2, "fragments that the whole pupil sees")
    every = torch.nonzero(whole).squeeze(1)
    weights = responses or [channel_weights(camera, part.wavelengths) for camera in cameras]
    pairs = list(zip(cameras, weights, strict=True))
    photos = [_unclipped(part, every, *pair, window, cache) for pair in pairs]
    clipped = _clipped(part, some, seen, nearer, cameras, weights, window, say)
    say(1.0, "done")
    return [part.crop_margin(photo + more) for photo, more in zip(photos, clipped, strict=True)]


def _near_the_pupil(rays: int, radius: float) -> np.ndarray:
    """Which points of `pupil_points` lie in the pupil or so near that edges there matter: bool [y, x]."""
    points = pupil_points(rays, SPAN * radius)
    return np.hypot(points[..., 0], points[..., 1]) <= NEAR * radius


def check_crop(view: View, where: Crop) -> None:
    """Raise InputError for a crop that does not lie in the frame."""
    if not (
        0 <= where.top < where.top + where.height <= view.height
        and 0 <= where.left < where.left + where.width <= view.width
    ):
        raise InputError(
            f"the crop of {where.width} x {where.height} pixels at column {where.left}, row {where.top} does "
            f"not lie in the frame of {view.width} x {view.height}: give X,Y,WIDTH,HEIGHT inside it, in "
            "pixels from the top left corner"
        )


def _visibility(
    part: View,
    view: View,
    model: SceneModel,
    camera: Camera,
    where: Crop,
    margin: int,
    rays: int,
    device: str,
    say: Progress,
) -> tuple[np.ndarray, np.ndarray]:
    """What rays from around the pupil see of each fragment: float32 [fragment, y, x] in [0, 1], and how much
    nearer what blocks it is, [fragment] in 1/m (0 if nothing does)."""
    mi = use_engine(device)

    scene = build_stage(mi, model).scene
    points = pupil_points(rays, SPAN * camera.aperture_radius)
    pixel, depth = part.pixel.numpy(), part.inverse_depth.numpy()

    def at(which: np.ndarray, down: float | np.ndarray, right: float | np.ndarray) -> np.ndarray:
        return pixel_directions(view, where, margin, pixel[which], (down, right))

    every = np.arange(len(pixel))
    spread = _spread(pixel, part.padded_shape[1])
    down, right, exact = _places(
        mi, scene, lambda d, r: at(every, d, r), depth, part.hidden.numpy(), spread[:, :2]
    )
    shift = spread[:, 2:]
    found, nearer = visible(
        mi, scene, at(every, down, right), exact, points, lambda f: say(0.15 * f, "rays"), shift
    )
    seen = found.astype(np.float32)
    blocked = (~found).sum((1, 2)).astype(np.float64)
    partial = np.flatnonzero(part.coverage.numpy() < FULL)
    if partial.size:
        hidden = part.hidden.numpy()[partial]
        places = places_of(mi, scene, lambda d, r: at(partial, d, r), depth[partial], hidden)
        total = np.zeros((partial.size, rays, rays), np.float32)
        gaps, count = np.zeros(partial.size), np.zeros(partial.size)
        for look in range(RAY_ROUNDS):
            down, right = _somewhere(places, look)
            found, gap = visible(
                mi, scene, at(partial, down, right), depth[partial], points, shift=shift[partial]
            )
            total += found
            gaps += gap
            count += (~found).sum((1, 2))
            say(0.15 + 0.05 * (look + 1) / RAY_ROUNDS, "rays at edges")
        seen[partial] = total / RAY_ROUNDS
        nearer[partial], blocked[partial] = gaps, count
    return seen, nearer / np.maximum(blocked, 1)


def _spread(pixel: np.ndarray, columns: int) -> np.ndarray:
    """Numbers from -1/2 to 1/2, four for each pixel, that cover the range evenly along rows and columns:
    [n, 4]. Multiples of irrational numbers (Weyl): their averages settle faster than those of random ones."""
    row, column = np.divmod(pixel, columns)
    first, second = np.sqrt([2.0, 3.0, 5.0, 7.0]), np.sqrt([11.0, 13.0, 17.0, 19.0])
    return (row[:, None] * first + column[:, None] * second) % 1.0 - 0.5


def _places(
    mi: ModuleType,
    scene: mi.Scene,
    at: Callable[[np.ndarray, np.ndarray], np.ndarray],
    depth: np.ndarray,
    hidden: np.ndarray,
    spread: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where each fragment is looked at: (down, right) in pixels from its pixel's centre, and its inverse
    depth there, [fragment] each.

    A fragment fills its pixel, and the edges of the shadows of many would else all lie at centres: it is
    looked at off the centre by `spread` [fragment, 2] if that shows the same surface, with the depth there;
    a hidden one at its centre.
    """
    down, right = spread.T
    there = first_hits(mi, scene, at(down, right))
    same = ~hidden & (np.abs(there - depth) < SLOPE)
    return np.where(same, down, 0.0), np.where(same, right, 0.0), np.where(same, there, depth)


def _somewhere(places: np.ndarray, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """(down, right) from their pixels' centres of one place of each fragment, drawn from those that it fills.

    places: bool [place, place, fragment], some of each fragment's true.
    """
    generator = np.random.default_rng([1, seed])
    chance = places.reshape(-1, places.shape[-1]) * generator.uniform(0.1, 1.0, (PLACES**2, places.shape[-1]))
    row, column = np.divmod(chance.argmax(0), PLACES)
    return (row + 0.5) / PLACES - 0.5, (column + 0.5) / PLACES - 0.5


def _unclipped(
    part: View, which: Tensor, camera: Camera, weights: Tensor, window: int, cache: Path | None
) -> Tensor:
    """Photo of the fragments that the whole pupil sees: linear, with PSFs at close depth nodes."""
    depth = part.inverse_depth[which]
    if not depth.numel():
        return torch.zeros(len(weights), *part.padded_shape, dtype=torch.float64)
    low, high = float(depth.min()), float(depth.max())
    per_dioptre = math.pi / float(part.wavelengths.min()) * camera.aperture_radius**2
    count = 2 + math.floor((high - low) * per_dioptre / DEFOCUS_STEP) if high > low else 1
    nodes = torch.linspace(low, high, count, dtype=torch.float64)
    psfs = psf_bank(camera, part.wavelengths, nodes, window_px=window, cache=cache).values
    rows, columns = part.padded_shape
    size = (rows + window - 1, columns + window - 1)
    place = (depth - low) / max(high - low, 1e-12) * (count - 1)
    total = torch.zeros(len(weights), size[0], size[1] // 2 + 1, dtype=torch.complex128)
    for node in range(count):
        share = (1 - (place - node).abs()).clamp_min(0)
        some = torch.nonzero(share).squeeze(1)
        if not some.numel():
            continue
        light = torch.zeros(part.bands, rows * columns, dtype=torch.float64)
        light.index_add_(1, part.pixel[which[some]], part.radiance[:, which[some]] * share[some])
        through = torch.fft.rfft2(psfs[node].double(), s=size)
        through *= torch.fft.rfft2(light.reshape(-1, rows, columns), s=size)
        total += torch.einsum("cb,byx->cyx", weights.to(total), through)
    centre = window // 2
    return torch.fft.irfft2(total, s=size)[:, centre : centre + rows, centre : centre + columns]


def _clipped(
    part: View,
    which: Tensor,
    seen: np.ndarray,
    nearer: np.ndarray,
    cameras: Sequence[Camera],
    weights: Sequence[Tensor],
    window: int,
    say: Progress,
) -> list[Tensor]:
    """Photos of the fragments that only a part of the pupil sees, one PSF for each fragment and band."""
    rows, columns = part.padded_shape
    reach = window // 2
    size = (rows + 2 * reach, columns + 2 * reach)
    canvases = [torch.zeros(len(each), *size, dtype=torch.float64) for each in weights]
    inside = (slice(None), slice(reach, reach + rows), slice(reach, reach + columns))
    if not which.numel():
        return [canvas[inside] for canvas in canvases]
    depths = part.inverse_depth[which]
    by_phase = [replace(each, by_phase=True) for each in cameras]
    grids = [plan_sampling(each, part.wavelengths, depths, window) for each in by_phase]
    grid = max(grids, key=lambda each: each.samples)
    openings = [aperture(camera, grid) for camera in cameras]
    lets_by = torch.from_numpy(np.ascontiguousarray(seen[which.numpy()]))
    gaps = torch.from_numpy(nearer[which.numpy()])
    width = 2 * SPAN * cameras[0].aperture_radius
    done, total = 0, part.bands * len(which)
    for band, wavelength in enumerate(part.wavelengths.tolist()):
        pupils = [
            pupil_function(camera, opening, wavelength)
            for camera, opening in zip(cameras, openings, strict=True)
        ]
        transforms = [make_transform(camera, grid, wavelength, window) for camera in cameras]
        for begin in range(0, len(which), BATCH):
            some = slice(begin, begin + BATCH)
            wave = shadow(lets_by[some], gaps[some], width, wavelength, grid)
            pixels = part.pixel[which[some]].tolist()
            for number, camera in enumerate(cameras):
                psi = defocus(camera, wavelength, depths[some])
                pupil = bent(pupils[number], openings[number], wavelength, depths[some])
                psf = clipped_psf(pupil, openings[number], psi, wave, transforms[number])
                light = weights[number][:, band, None] * part.radiance[band, which[some]]
                for k, pixel in enumerate(pixels):
                    row, column = divmod(pixel, columns)
                    here = canvases[number][:, row : row + window, column : column + window]
                    here += light[:, k, None, None] * psf[k]
            done += len(pixels)
            say(0.25 + 0.75 * done / total, f"pupils seen in part: {done} of {total}")
    return [canvas[inside] for canvas in canvases]
