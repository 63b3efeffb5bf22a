"""The hard views themselves, and the small cameras that photograph them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import torch
from torch import Tensor

from ..optics import Camera
from ..optics.lenses.plano_convex import PlanoConvexLens
from ..optics.masks import Mask
from ..optics.masks.clear import ClearMask
from ..optics.masks.coded import CodedMask
from ..optics.masks.cubic import CubicMask
from ..optics.masks.height_map import HeightMapMask
from ..recipe.camera import CameraRecipe, PsfSettings
from ..render.view import View

WINDOW, ROWS, COLUMNS = 17, 14, 19
PADDED = (ROWS + 2 * (WINDOW // 2), COLUMNS + 2 * (WINDOW // 2))
MIDDLE = PADDED[0] // 2 * PADDED[1] + PADDED[1] // 2
"""The pixel in the middle of the frame."""
NANOMETRES = (450.0, 500.0, 550.0, 600.0, 650.0)

MASKS: Mapping[str, Mask] = {
    "clear": ClearMask(),
    "coded": CodedMask(),
    "cubic": CubicMask(alpha_rad=6.0),
    "free": HeightMapMask(pitch_um=100.0),
}


def camera_with(mask: Mask, aperture_mm: float = 0.6, **sensor: object) -> Camera:
    """A camera with so small a pupil that its blur stays within small frames."""
    recipe = CameraRecipe(
        name="hard",
        lens=PlanoConvexLens(aperture_radius_mm=aperture_mm),
        mask=mask,
        psf=PsfSettings(window_px=WINDOW),
    )
    if sensor:
        recipe = recipe.model_copy(update={"sensor": recipe.sensor.model_copy(update=sensor)})
    return Camera.from_recipe(recipe)


def free_height(camera: Camera) -> Tensor | None:
    """A smooth random height map for the free mask, float64 [n, n] in metres; None for other masks."""
    if not isinstance(camera.recipe.mask, HeightMapMask):
        return None
    samples = round(2 * camera.aperture_radius / (camera.recipe.mask.pitch_um * 1e-6))
    coarse = torch.rand(1, 1, 4, 4, dtype=torch.float64, generator=torch.Generator().manual_seed(2))
    size = (samples, samples)
    return torch.nn.functional.interpolate(coarse, size, mode="bicubic", align_corners=True)[0, 0] * 1e-6


def with_free_height(camera: Camera) -> Camera:
    """The camera; with `free_height` where its mask is free."""
    return camera.with_height(free_height(camera))


def small_cameras() -> dict[str, Camera]:
    """The small cameras, one for each of `MASKS`."""
    return {name: with_free_height(camera_with(mask)) for name, mask in MASKS.items()}


def with_small_window(camera: Camera) -> Camera:
    """The camera with PSFs in the window of the hard views."""
    psf = camera.recipe.psf.model_copy(update={"window_px": WINDOW})
    return replace(camera, recipe=camera.recipe.model_copy(update={"psf": psf}))


def flat(
    inverse_depth: Tensor | float,
    rows: int = ROWS,
    columns: int = COLUMNS,
    wavelengths: tuple[float, ...] = NANOMETRES,
) -> View:
    """One opaque fragment a pixel, nothing hidden.

    inverse_depth: [y, x] of the frame with its margin, or a number.
    """
    margin = WINDOW // 2
    return View.flat(
        0.1 + 0.9 * uniform(len(wavelengths), rows + 2 * margin, columns + 2 * margin),
        inverse_depth,
        wavelengths=torch.tensor(wavelengths, dtype=torch.float64) * 1e-9,
        pixel_angle=camera_with(ClearMask()).pixel_angle,
        margin=margin,
        metadata={"hidden": "none"},
    )


def uniform(*shape: int, seed: int = 0) -> Tensor:
    """Random numbers in [0, 1), float64."""
    return torch.rand(*shape, dtype=torch.float64, generator=torch.Generator().manual_seed(seed))


def layered_view(front: Tensor, near: float, far: float, behind: Tensor | float = 0.0) -> View:
    """A front surface of coverage `front` [y, x] at inverse depth `near` over a background at `far`, of which
    the part `behind` of the covered is rendered too, as hidden.

    front, behind: [y, x], coverage.
    """
    base = flat(far)
    shape = base.padded_shape
    front, behind = front.expand(shape).reshape(-1), torch.as_tensor(behind).expand(shape).reshape(-1)
    colours = 0.1 + 0.9 * uniform(base.bands, front.numel(), seed=1)
    pixel = torch.arange(front.numel())
    parts = [
        (pixel, front, near, colours, False),
        (pixel, 1 - front, far, base.radiance, False),
        (pixel, front * behind, far, base.radiance, True),
    ]
    order = torch.argsort(torch.cat([3 * part[0] + k for k, part in enumerate(parts)]))
    coverage = torch.cat([part[1] for part in parts])
    radiance = torch.cat([part[3] * part[1] for part in parts], 1)
    depth = torch.cat([torch.full_like(front, part[2]) for part in parts])
    hidden = torch.cat([torch.full_like(front, part[4], dtype=torch.bool) for part in parts])
    return replace(
        base,
        pixel=torch.cat([part[0] for part in parts])[order],
        coverage=coverage[order],
        inverse_depth=depth[order],
        radiance=radiance[:, order],
        hidden=hidden[order],
    )


def across(values: Tensor) -> Tensor:
    """Values [x] of the padded frame for each of its rows.

    values: [x].
    """
    return values.expand(PADDED)


def half(left: float, right: float) -> Tensor:
    """Two values side by side, a step between two pixels of the frame."""
    return across(torch.where(torch.arange(PADDED[1]) < PADDED[1] // 2, left, right).double())
