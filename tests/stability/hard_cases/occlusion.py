"""Hard occlusion: a half plane before a wall, against geometry that is no compositing of layers."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from edofsim.capture import Fidelity, capture
from edofsim.capture.prepare import blur_per_dioptre
from edofsim.optics import Camera
from edofsim.optics.lenses.plano_convex import PlanoConvexLens
from edofsim.optics.masks.clear import ClearMask
from edofsim.optics.masks.cubic import CubicMask
from edofsim.recipe.camera import CameraRecipe, PsfSettings
from edofsim.render.view import View
from edofsim.stability.case import Case, Finding, timed
from edofsim.stability.measures import typical, worst
from edofsim.stability.true_photos import Scene
from edofsim.stability.views import (
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
RAYS: Mapping[str, float] = {"hidden": 0.1, "hidden through 3 x 3 sub-apertures": 0.025}
"""Root mean square against rays within a blur of the edge, both surfaces blurred. The products of `hidden`
know averages over the pupil alone: 0.08 was seen; sub-apertures see more: 0.018, and 0.027 where what they
show is taken for all that there is. Plain blur errs by 0.15."""
BENT: Mapping[str, float] = {"hidden": 0.2, "hidden through 3 x 3 sub-apertures": 0.105}
"""Likewise through a cubic mask, whose blur leaves the window: 0.182 and 0.100 were seen, 0.108 where what
sub-apertures show is taken for all that there is, and 0.118 where the whole pupil stands in for those with
half of their light outside."""
STRIPES_PX = 12.0
WIRE, PLATE, WALL = 0.6, 0.25, 1.0
PLATE_PX = 6
"""Of a plate, on the near side of its bend."""
THREE = 0.08
"""At the worst pixel, wall in focus: 0.056 was seen, the diffraction that rays do not have; a plate that is
cut through errs by 0.3 to 0.65."""
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


def _wide_camera(alpha_rad: float = 0.0) -> Camera:
    """The paper's aperture without spherical aberration, so that its blur is a disc, or what a cubic mask
    makes of it."""
    lens = PlanoConvexLens(surface_profile="parabolic")
    psf = PsfSettings(window_px=WINDOW)
    mask = CubicMask(alpha_rad=alpha_rad) if alpha_rad else ClearMask()
    return Camera.from_recipe(CameraRecipe(name="hard", lens=lens, mask=mask, psf=psf))


def _by_rays(surfaces: Sequence[tuple[Array, float]], radius: float, alpha_rad: float = 0.0) -> Array:
    """The photo [y, x] of opaque surfaces, near to far: rays from each sub-pixel through each point of a
    round pupil of `radius` [m] to the first that they meet.

    surfaces: pictures, NaN where a surface is not, with 1/z [1/m] of each; the last one has the size of the
    photo, others may have several columns for one of it. alpha_rad: of a cubic mask at FOCUS_LINE, whose
    slope bends rays by 3 alpha u^2 wavelength / (2 pi radius), u across the radius.
    """
    number = np.arange(POINTS) + 0.5
    length, angle = np.sqrt(number / POINTS), number * math.pi * (3 - math.sqrt(5))
    per_dioptre = radius * sensor_distance() / PIXEL
    bent = 3 * alpha_rad * FOCUS_LINE / (2 * math.pi * radius) * sensor_distance() / PIXEL
    place = (np.arange(4) + 0.5) / 4
    rows, columns = surfaces[-1][0].shape
    y = (np.arange(rows)[:, None] + place).ravel()[:, None]
    x = (np.arange(columns)[:, None] + place).ravel()[None, :]

    def met(picture: Array, depth: float, number: int) -> Array:
        u, v = (length[number] * turn(angle[number]) for turn in (math.cos, math.sin))
        shift = per_dioptre * (depth - 1 / FOCUS)
        finer = picture.shape[1] // columns
        down = np.floor(y + shift * v + bent * v**2).astype(int).clip(0, rows - 1)
        right = np.floor(finer * (x + shift * u + bent * u**2)).astype(int)
        found: Array = picture[down, right.clip(0, finer * columns - 1)]
        return found

    total = np.zeros((4 * rows, 4 * columns))
    for each in range(POINTS):
        seen = np.full_like(total, np.nan)
        for picture, depth in surfaces:
            seen = np.where(np.isnan(seen), met(picture, depth, each), seen)
        total += seen
    averaged: Array = total.reshape(rows, 4, columns, 4).mean((1, 3)) / POINTS
    return averaged


def _blurred_both(
    nearer: float, farther: float, bounds: Mapping[str, float], alpha_rad: float = 0.0
) -> Iterator[Finding]:
    """A striped half plane nearer than the focus, a striped wall behind it, by so much in 1/m; alpha_rad: of
    a cubic mask."""
    near, far = 1 / FOCUS + nearer, 1 / FOCUS - farther
    view = layered_view(half(1.0, 0.0), near, far, 1.0)
    along = np.arange(PADDED[1]) * 2 * math.pi / STRIPES_PX
    front, back = (np.broadcast_to(0.55 + 0.45 * np.sin(along + lag), PADDED).copy() for lag in (0.0, 1.5))
    camera = _wide_camera(alpha_rad)
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
    rays = _by_rays([(seen, near), (back, far)], camera.aperture_radius, alpha_rad)
    truth = torch.from_numpy(rays[inside]).expand(3, -1, -1)
    for way, fidelity in WAYS.items():
        for dtype in PRECISIONS:
            yield timed(
                f"{way}, {str(dtype).removeprefix('torch.')}",
                bounds[way],
                lambda f=fidelity, d=dtype: typical(_photo(view, camera, f, d)[NEAR_EDGE], truth[NEAR_EDGE]),
            )


def _three_surfaces() -> Iterator[Finding]:
    """A wire before the farther half of a plate that is a little bent, and a bright wall behind it, in focus.

    The wire fills half of its pixels: where it hides the plate, the plate is seen beside it. Cut between wire
    and farther half and between nearer half and wall at once, the plate itself would be cut through, and the
    wall behind it shine through there.
    """
    rows, columns = PADDED
    camera = _wide_camera()
    bend, wire = columns // 2, columns // 2 + 4
    wall, near, half_bent = 1 / FOCUS, 1 / FOCUS + 0.2, 0.4 / blur_per_dioptre(camera)
    x = np.arange(columns)
    # column, coverage, 1/z, value, hidden; near to far within a column
    parts = [(wire, 0.5, near + 0.1, WIRE, False)]
    parts += [
        (column, covered, near + (half_bent if column < bend else -half_bent), PLATE, hidden)
        for column in x[x >= bend - PLATE_PX]
        for covered, hidden in ([(0.5, False), (0.5, True)] if column == wire else [(1.0, False)])
    ]
    parts += [(column, 1.0, wall, WALL, bool(column >= bend - PLATE_PX)) for column in x]
    parts.sort(key=lambda part: (part[0], -part[2], part[4]))
    column, coverage, depth, value, hidden = (torch.tensor(each) for each in zip(*parts, strict=True))
    count = len(parts)
    line = torch.arange(rows).repeat_interleave(count) * columns
    view = replace(
        layered_view(half(1.0, 0.0), near, wall, 1.0),
        pixel=line + column.repeat(rows),
        coverage=coverage.double().repeat(rows),
        inverse_depth=depth.double().repeat(rows),
        hidden=hidden.repeat(rows),
        radiance=(coverage * value).double().repeat(rows)[None],
        wavelengths=torch.tensor([FOCUS_LINE], dtype=torch.float64),
    )

    def picture(there: NDArray[np.bool_], value: float) -> Array:
        return np.broadcast_to(np.where(there, value, np.nan), (rows, there.size))

    thin = np.arange(2 * columns) == 2 * wire
    surfaces = [
        (picture(thin, WIRE), near + 0.1),
        (picture((x >= bend - PLATE_PX) & (x < bend), PLATE), near + half_bent),
        (picture(x >= bend, PLATE), near - half_bent),
        (picture(x >= 0, WALL), wall),
    ]
    m = view.margin
    rays = _by_rays(surfaces, camera.aperture_radius)[m : rows - m, m : columns - m]
    truth = torch.from_numpy(rays.copy()).expand(3, -1, -1)
    for way, fidelity in WAYS.items():
        for dtype in PRECISIONS:
            yield timed(
                f"{way}, {str(dtype).removeprefix('torch.')}",
                THREE,
                lambda f=fidelity, d=dtype: worst(_photo(view, camera, f, d), truth),
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
        lambda: _blurred_both(0.25, 0.25, RAYS),
    ),
    Case(
        "both sides blurred by a cubic mask",
        "occlusion",
        "stripes on both sides of the focus, a blur that leaves the window",
        "sub-apertures whose light is mostly outside",
        "rays through 400 points of the pupil, bent by the mask's slope",
        lambda: _blurred_both(0.6, 0.3, BENT, alpha_rad=10.0),
    ),
    Case(
        "three behind one another",
        "occlusion",
        "a wire, a bent plate and a wall",
        "a plate that is cut through between the others",
        "rays through 400 points of the pupil",
        _three_surfaces,
    ),
)
