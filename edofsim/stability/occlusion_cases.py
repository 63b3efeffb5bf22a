"""Hard occlusion: a half plane before a wall, against geometry that is no compositing of layers."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from ..capture import Fidelity, capture
from ..optics import Camera
from ..optics.lenses.plano_convex import PlanoConvexLens
from ..optics.masks.clear import ClearMask
from ..recipe.camera import CameraRecipe, PsfSettings
from ..render.view import View
from .case import Case, Finding, timed
from .measures import typical, worst
from .true_photos import Scene
from .views import (
    COLUMNS,
    MASKS,
    NANOMETRES,
    PADDED,
    ROWS,
    WINDOW,
    camera_with,
    half,
    layered_view,
    with_free_height,
)
from .written_out import FOCUS, FOCUS_LINE, PIXEL, Array, sensor_distance

NEAR, FAR = 1.2, 0.4
EDGE = 9
"""The first column right of the half plane."""
WIDE = 97
"""Pixels of a window that holds nearly all light; half planes go on beyond the frame as their borders are."""
PRECISIONS = (torch.float64, torch.float32)
WAYS: Mapping[str, Fidelity] = {
    "hidden": Fidelity(occlusion="hidden", layers_db=50.0),
    "hidden through 3 x 3 sub-apertures": Fidelity(occlusion="hidden", layers_db=50.0, sub_apertures=3),
}
EVEN = 0.04
"""At the worst pixel: 3e-2 were seen. Light beyond a PSF's window is 2 % of all, and comes back as even
glare, not where it belongs; the diffraction of sub-apertures is as much."""
RAYS: Mapping[str, float] = {"hidden": 0.1, "hidden through 3 x 3 sub-apertures": 0.04}
"""Root mean square against rays within a blur of the edge, both surfaces blurred. The products of `hidden`
know averages over the pupil alone: 0.08 was seen; sub-apertures see more: 0.028. Plain blur errs by 0.15."""
STRIPES_PX = 12.0
NEAR_EDGE = (..., slice(EDGE - 4, EDGE + 5))
POINTS = 400
"""Of the pupil that rays go through, on a spiral that covers it evenly (Vogel, Math. Biosci. 44, 1979)."""


def _photo(view: View, camera: Camera, fidelity: Fidelity, dtype: torch.dtype) -> Tensor:
    return capture(view, camera, fidelity, exposure=1.0, dtype=dtype).clean.double()


def _half_plane(near: float, far: float) -> View:
    """A half plane of one radiance, left of the middle, before a wall of another, as wide as blur reaches."""
    margin = WIDE // 2
    rows, columns = ROWS + 2 * margin, COLUMNS + 2 * margin
    every = torch.arange(rows * columns)
    left = every[every % columns < margin + EDGE]
    pixel = torch.cat([left, every])
    front = torch.arange(pixel.numel()) < left.numel()
    behind = ~front & (pixel % columns < margin + EDGE)
    order = torch.argsort(2 * pixel + behind)
    colour = torch.where(front, near, far).double()[order]
    return View(
        height=ROWS,
        width=COLUMNS,
        margin=margin,
        pixel=pixel[order],
        coverage=torch.ones_like(colour),
        inverse_depth=torch.where(front, NEAR, FAR).double()[order],
        radiance=colour.expand(len(NANOMETRES), -1).contiguous(),
        hidden=behind[order],
        wavelengths=torch.tensor(NANOMETRES, dtype=torch.float64) * 1e-9,
        pixel_angle=camera_with(ClearMask()).pixel_angle,
    )


def _covered(view: View, camera: Camera) -> Tensor:
    """The part of each pixel's light that a half plane left of the middle holds, [channel, 1, x] of the
    frame: the sum of its PSF up to the edge."""
    scene = Scene(view, camera, WIDE)
    total = np.zeros((3, view.width))
    for band in range(view.bands):
        columns = scene.psf(band, NEAR).sum(0)
        held = np.concatenate([[0.0], np.cumsum(columns)]) / columns.sum()
        # pixel x sees column x' through the PSF's column x - x' + centre
        first = np.clip(np.arange(view.width) - EDGE + 1 + WIDE // 2, 0, WIDE)
        total += scene.response[:, band, None] * (1 - held[first])
    return torch.from_numpy(total)[:, None]


def _even(near: float, far: float) -> Iterator[Finding]:
    """Even surfaces: whatever is blurred, a pixel shows a A + b (1 - A), A the part of its light that the
    half plane holds."""
    view = _half_plane(near, far)
    for name in ("clear", "cubic", "free"):
        camera = with_free_height(camera_with(MASKS[name]))
        covered = _covered(view, camera).expand(-1, view.height, -1)
        truth = near * covered + far * (1 - covered)
        for way, narrow in WAYS.items():
            fidelity = narrow.changed({"window_px": WIDE})
            for dtype in PRECISIONS:
                yield timed(
                    f"{way}, {name}, {str(dtype).removeprefix('torch.')}",
                    EVEN,
                    lambda c=camera, f=fidelity, d=dtype, t=truth: worst(_photo(view, c, f, d), t),
                )


def _wide_camera() -> Camera:
    """The paper's aperture without spherical aberration, so that its blur is a disc."""
    lens = PlanoConvexLens(surface_profile="parabolic")
    psf = PsfSettings(window_px=WINDOW)
    return Camera.from_recipe(CameraRecipe(name="hard", lens=lens, mask=ClearMask(), psf=psf))


def _by_rays(front: Array, back: Array, near: float, far: float, radius: float) -> Array:
    """The photo of an opaque half plane, where `front` is not NaN, before a wall: rays from each sub-pixel
    through each point of a round pupil of `radius` [m]. front, back: [y, x]; near, far: 1/z [1/m]."""
    number = np.arange(POINTS) + 0.5
    length, angle = np.sqrt(number / POINTS), number * math.pi * (3 - math.sqrt(5))
    per_dioptre = radius * sensor_distance() / PIXEL
    place = (np.arange(4) + 0.5) / 4
    rows, columns = front.shape
    y = (np.arange(rows)[:, None] + place).ravel()[:, None]
    x = (np.arange(columns)[:, None] + place).ravel()[None, :]

    def met(picture: Array, depth: float, number: int) -> Array:
        shift = length[number] * per_dioptre * (depth - 1 / FOCUS)
        down = np.floor(y + shift * math.sin(angle[number])).astype(int).clip(0, rows - 1)
        right = np.floor(x + shift * math.cos(angle[number])).astype(int).clip(0, columns - 1)
        found: Array = picture[down, right]
        return found

    total = np.zeros((4 * rows, 4 * columns))
    for each in range(POINTS):
        nearer = met(front, near, each)
        total += np.where(np.isnan(nearer), met(back, far, each), nearer)
    averaged: Array = total.reshape(rows, 4, columns, 4).mean((1, 3)) / POINTS
    return averaged


def _blurred_both() -> Iterator[Finding]:
    """A striped half plane nearer than the focus, a striped wall as far behind it."""
    near, far = 1 / FOCUS + 0.25, 1 / FOCUS - 0.25
    view = layered_view(half(1.0, 0.0), near, far, 1.0)
    along = np.arange(PADDED[1]) * 2 * math.pi / STRIPES_PX
    front, back = (np.broadcast_to(0.55 + 0.45 * np.sin(along + lag), PADDED).copy() for lag in (0.0, 1.5))
    camera = _wide_camera()
    painted = [torch.from_numpy(each).reshape(-1)[view.pixel] for each in (front, back)]
    amount = torch.where(view.inverse_depth > 1 / FOCUS, painted[0], painted[1])
    view = replace(
        view,
        radiance=(amount * view.coverage)[None],
        wavelengths=torch.tensor([FOCUS_LINE], dtype=torch.float64),
    )
    seen = np.where((half(1.0, 0.0) > 0.5).numpy(), front, np.nan)
    rows, columns = PADDED
    inside = slice(view.margin, rows - view.margin), slice(view.margin, columns - view.margin)
    truth = torch.from_numpy(_by_rays(seen, back, near, far, camera.aperture_radius)[inside]).expand(
        3, -1, -1
    )
    for way, fidelity in WAYS.items():
        for dtype in PRECISIONS:
            yield timed(
                f"{way}, {str(dtype).removeprefix('torch.')}",
                RAYS[way],
                lambda f=fidelity, d=dtype: typical(_photo(view, camera, f, d)[NEAR_EDGE], truth[NEAR_EDGE]),
            )


CASES: tuple[Case, ...] = (
    Case(
        "white room",
        "occlusion",
        "a half plane and a wall of the same radiance",
        "a seam along the edge",
        "the same radiance everywhere",
        lambda: _even(0.7, 0.7),
    ),
    Case(
        "bright before dark",
        "occlusion",
        "an even half plane before an even wall, 5 to 2",
        "light of the wall that passes the half plane",
        "the part of the pupil that the edge leaves",
        lambda: _even(1.0, 0.4),
    ),
    Case(
        "dark before bright",
        "occlusion",
        "an even half plane before an even wall, 2 to 5",
        "a dark fringe, light that leaks past the edge",
        "the part of the pupil that the edge leaves",
        lambda: _even(0.4, 1.0),
    ),
    Case(
        "both sides blurred",
        "occlusion",
        "stripes on both sides of the focus",
        "averages over the pupil where rays tell it apart",
        "rays through 400 points of the pupil",
        _blurred_both,
    ),
)
