"""The clipped pupil: each fragment seen through that part of the pupil to which nothing blocks its light.

A point's photo is |F{Q V}|^2 with Q the generalised pupil function (Akpinar et al., Eq. `Q`) and V the light
of the point in the pupil: the shadow of what stands in the way, as rays draw it, with the diffraction at its
edges. Without that, light would bend at edges in the pupil instead of where they are, and a white room would
not look white. The photo of a scene is the sum over points, which are incoherent. Any mask; slow: one
transform for each fragment and band that is seen in part.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from ..errors import InputError
from ..expose.blurring import Blurring
from ..expose.crop import crop as cropped
from ..expose.kernels import HeldKernels
from ..expose.methods import METHODS
from ..expose.prepare import channel_weights
from ..optics import Camera, defocus, plan_sampling, psf_bank
from ..optics.pupil import aperture, pupil_function
from ..render.engine import use_engine
from ..render.view import View
from ..scene.model import SceneModel
from .clipped_psf import clipped_psf, make_transform, shadow
from .pinhole import Crop, pixel_directions
from .visibility import PLACES, places_of, pupil_points, visible

Progress = Callable[[float, str], None]

RAYS = 96
"""Pupil points across a square of twice the pupil's diameter."""
DEFOCUS_STEP = 1.5
"""Nodes for the fragments that the whole pupil sees, in radians of Psi: interpolation errs below 60 dB."""
SPAN = 2.0
"""Half-width of the square that is looked at, in pupil radii: shadows beyond the rim bend light into it."""
BATCH = 16
FULL = 0.999
"""A fragment of less coverage lies somewhere in its pixel, not all over it."""


def clipped_pupil(
    view: View,
    model: SceneModel,
    camera: Camera,
    where: Crop,
    *,
    window_px: int | None = None,
    rays: int = RAYS,
    height: Tensor | None = None,
    cache: Path | None = None,
    device: str = "auto",
    progress: Progress | None = None,
) -> Tensor:
    """Noise-free, unexposed photo of a part of the frame: [channel, y, x], float64.

    view: of the scene `model`, through a pinhole; where: small, for each fragment within a PSF's reach that
    is seen in part costs a transform a band. rays: across a square of twice the pupil's diameter. The light
    is the view's own: its noise is in this image too, and what differs in `expose` is blur and occlusion.
    Raises InputError for a crop outside the frame, EngineError where no rays can be traced.
    """
    say = progress or (lambda fraction, text: None)
    _check(view, where)
    window = window_px or camera.recipe.psf.window_px
    reach = window // 2
    part = cropped(view, where.top, where.left, where.height, where.width, reach).to(dtype=torch.float64)
    weights = channel_weights(camera, part.wavelengths)
    say(0.0, "loading the scene")
    seen, nearer = _visibility(part, view, model, camera, where, reach, rays, device, say)
    whole = torch.from_numpy((seen == 1).all((1, 2)))
    none = torch.from_numpy(~seen.any((1, 2)))
    say(0.2, "fragments that the whole pupil sees")
    photo = _unclipped(part, torch.nonzero(whole).squeeze(1), camera, weights, window, height, cache)
    some = torch.nonzero(~whole & ~none).squeeze(1)
    clipped = _clipped(part, some, seen, nearer, camera, weights, window, height, say)
    say(1.0, "done")
    return part.crop_margin(photo + clipped)


def _check(view: View, where: Crop) -> None:
    if not (
        0 <= where.top < where.top + where.height <= view.height
        and 0 <= where.left < where.left + where.width <= view.width
    ):
        raise InputError(
            f"the crop of {where.width} x {where.height} pixels at row {where.top}, column {where.left} does "
            f"not lie in the frame of {view.width} x {view.height}: --crop takes TOP,LEFT,HEIGHT,WIDTH inside"
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
    from ..render.translate import build_stage

    scene = build_stage(mi, model).scene
    points = pupil_points(rays, SPAN * camera.aperture_radius)
    pixel, depth = part.pixel.numpy(), part.inverse_depth.numpy()

    def at(which: np.ndarray, down: float = 0.0, right: float = 0.0) -> np.ndarray:
        return pixel_directions(view, where, margin, pixel[which], (down, right))

    every = np.arange(len(pixel))
    found, nearer = visible(mi, scene, at(every), depth, points, lambda f: say(0.15 * f, "rays"))
    seen = found.astype(np.float32)
    blocked = (~found).sum((1, 2)).astype(np.float64)
    partial = np.flatnonzero(part.coverage.numpy() < FULL)
    if partial.size:
        hidden = part.hidden.numpy()[partial]
        places = places_of(mi, scene, lambda d, r: at(partial, d, r), depth[partial], hidden)
        total = np.zeros((partial.size, rays, rays), np.float32)
        gaps, count = np.zeros(partial.size), np.zeros(partial.size)
        offsets = (np.arange(PLACES) + 0.5) / PLACES - 0.5
        for i, down in enumerate(offsets):
            for j, right in enumerate(offsets):
                here = np.flatnonzero(places[i, j])
                if here.size:
                    which = partial[here]
                    found, gap = visible(mi, scene, at(which, down, right), depth[which], points)
                    total[here] += found
                    gaps[here] += gap
                    count[here] += (~found).sum((1, 2))
            say(0.15 + 0.05 * (i + 1) / PLACES, "rays at edges")
        seen[partial] = total / places.sum((0, 1))[:, None, None]
        nearer[partial], blocked[partial] = gaps, count
    return seen, nearer / np.maximum(blocked, 1)


def _unclipped(
    part: View,
    which: Tensor,
    camera: Camera,
    weights: Tensor,
    window: int,
    height: Tensor | None,
    cache: Path | None,
) -> Tensor:
    """Photo of the fragments that the whole pupil sees: linear, with PSFs at close depth nodes."""
    depth = part.inverse_depth[which]
    if not depth.numel():
        return torch.zeros(len(weights), *part.padded_shape, dtype=torch.float64)
    low, high = float(depth.min()), float(depth.max())
    per_dioptre = math.pi / float(part.wavelengths.min()) * camera.aperture_radius**2
    count = 2 + math.floor((high - low) * per_dioptre / DEFOCUS_STEP) if high > low else 1
    nodes = torch.linspace(low, high, count, dtype=torch.float64)
    bank = psf_bank(camera, part.wavelengths, nodes, window_px=window, height=height, cache=cache)
    kernels = HeldKernels(bank.values.double(), nodes, part.wavelengths)
    return Blurring(kernels, weights, METHODS["layered"]).light(part, which)


def _clipped(
    part: View,
    which: Tensor,
    seen: np.ndarray,
    nearer: np.ndarray,
    camera: Camera,
    weights: Tensor,
    window: int,
    height: Tensor | None,
    say: Progress,
) -> Tensor:
    """Photo of the fragments that only a part of the pupil sees, one PSF for each fragment and band."""
    rows, columns = part.padded_shape
    reach = window // 2
    canvas = torch.zeros(len(weights), rows + 2 * reach, columns + 2 * reach, dtype=torch.float64)
    if not which.numel():
        return canvas[:, reach : reach + rows, reach : reach + columns]
    depths = part.inverse_depth[which]
    grid = plan_sampling(camera, part.wavelengths, depths, window).grid
    opening = aperture(camera, grid, height)
    lets_by = torch.from_numpy(np.ascontiguousarray(seen[which.numpy()]))
    gaps = torch.from_numpy(nearer[which.numpy()])
    width = 2 * SPAN * camera.aperture_radius
    done, total = 0, part.bands * len(which)
    for band, wavelength in enumerate(part.wavelengths.tolist()):
        pupil = pupil_function(camera, opening, wavelength)
        psi = defocus(camera, wavelength, depths)
        transform = make_transform(camera, grid, wavelength, window)
        for begin in range(0, len(which), BATCH):
            some = slice(begin, begin + BATCH)
            wave = shadow(lets_by[some], gaps[some], width, wavelength, grid)
            psf = clipped_psf(pupil, opening, psi[some], wave, transform)
            light = weights[:, band, None] * part.radiance[band, which[some]]
            for k, pixel in enumerate(part.pixel[which[some]].tolist()):
                row, column = divmod(pixel, columns)
                here = canvas[:, row : row + window, column : column + window]
                here += light[:, k, None, None] * psf[k]
            done += len(psi[some])
            say(0.25 + 0.75 * done / total, f"pupils seen in part: {done} of {total}")
    return canvas[:, reach : reach + rows, reach : reach + columns]
