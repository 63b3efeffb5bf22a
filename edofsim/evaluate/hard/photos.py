"""Photos of hard views, through every method, mask and precision.

The truth of a photo without occlusion is made here once more, by the simplest means: each fragment's own PSF
in float64, whole-image convolutions of each depth and band one by one, no layers, no tiles, no batches. With
occlusion no closed form exists for any view; there the photo must be finite, hold no more light than there
is, and agree in float32 and float64.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import torch
from scipy.signal import fftconvolve
from torch import Tensor

from ...expose import SensorEffects, expose
from ...optics import Camera, psf_bank, response
from ...recipe.camera import CameraRecipe, Lens, PsfSettings
from ...recipe.masks import AnyMask, ClearMask, CubicMask, HeightMapMask
from ...render.view import View
from .case import Case, Finding, timed

WINDOW, ROWS, COLUMNS = 17, 14, 19
NANOMETRES = (450.0, 500.0, 550.0, 600.0, 650.0)
QUIET = SensorEffects()

METHODS = ("brute", "layered", "low_rank")
OCCLUSIONS = ("over", "normalised", "hidden")
MASKS: Mapping[str, AnyMask] = {
    "clear": ClearMask(),
    "cubic": CubicMask(alpha_rad=6.0),
    "free": HeightMapMask(pitch_um=100.0),
}

SINGLE = 1e-4
"""float32 against float64, relative to the brightest value of the photo."""

LAYERED = 0.01
"""Photos in layers against each fragment's own PSF: root mean square error relative to the brightest value,
40 dB. The views are of white noise, for which the methods' tolerance (of natural images) does not speak."""


@dataclass(frozen=True)
class HardView:
    """view: through `camera_with(mask)`; layered, single: bounds in place of LAYERED and SINGLE; options: of
    `expose`; methods: those that apply."""

    view: View
    layered: float = LAYERED
    single: float = SINGLE
    options: Mapping[str, Any] = field(default_factory=dict)
    methods: tuple[str, ...] = METHODS


def camera_with(mask: AnyMask, aperture_mm: float = 0.6, **sensor: Any) -> Camera:
    """A camera with so small a pupil that its blur stays within small frames."""
    recipe = CameraRecipe(
        name="hard",
        lens=Lens(aperture_radius_mm=aperture_mm),
        mask=mask,
        psf=PsfSettings(window_px=WINDOW, oversampling=1),
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


def flat(
    inverse_depth: Tensor | float,
    radiance: Tensor | None = None,
    rows: int = ROWS,
    columns: int = COLUMNS,
    wavelengths: tuple[float, ...] = NANOMETRES,
) -> View:
    """One opaque fragment a pixel. inverse_depth: [y, x] of the frame with its margin, or a number."""
    margin = WINDOW // 2
    shape = (rows + 2 * margin, columns + 2 * margin)
    depth = torch.as_tensor(inverse_depth, dtype=torch.float64).expand(shape).reshape(-1).clone()
    if radiance is None:
        radiance = 0.1 + 0.9 * uniform(len(wavelengths), *shape)
    count = shape[0] * shape[1]
    return View(
        height=rows,
        width=columns,
        margin=margin,
        pixel=torch.arange(count),
        coverage=torch.ones(count, dtype=torch.float64),
        inverse_depth=depth,
        radiance=radiance.reshape(len(wavelengths), -1).clone(),
        hidden=torch.zeros(count, dtype=torch.bool),
        wavelengths=torch.tensor(wavelengths, dtype=torch.float64) * 1e-9,
        pixel_angle=camera_with(ClearMask()).pixel_angle,
    )


def uniform(*shape: int, seed: int = 0) -> Tensor:
    """Random numbers in [0, 1), float64."""
    return torch.rand(*shape, dtype=torch.float64, generator=torch.Generator().manual_seed(seed))


def layered_view(front: Tensor, near: float, far: float, behind: Tensor | float = 0.0) -> View:
    """A front surface of coverage `front` [y, x] at inverse depth `near` over a background at `far`, of which
    the part `behind` of the covered is rendered too, as hidden."""
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


def true_photo(view: View, camera: Camera, height: Tensor | None) -> Tensor:
    """Clean photo without occlusion, float64 [channel, y, x]: see the module's text."""
    rows, columns = view.padded_shape
    seen = ~view.hidden
    depths, member = torch.unique(view.inverse_depth[seen], return_inverse=True)
    weights = response(camera, view.wavelengths).double()
    out = np.zeros((3, rows, columns))
    for number, depth in enumerate(depths):
        psf = psf_bank(camera, view.wavelengths, depth[None], height=height, dtype=torch.float64).values[0]
        image = torch.zeros(view.bands, rows * columns, dtype=torch.float64)
        which = member == number
        image.index_add_(1, view.pixel[seen][which], view.radiance[:, seen][:, which])
        for band in range(view.bands):
            plane = image[band].reshape(rows, columns).numpy()
            start = (WINDOW - 1) // 2
            whole = fftconvolve(plane, psf[band].numpy(), mode="full")
            first = WINDOW - 1 - start
            blurred = whole[first : first + rows, first : first + columns]
            out += weights[:, band, None, None].numpy() * blurred
    return view.crop_margin(torch.from_numpy(out))


def findings(hard: HardView) -> Iterator[Finding]:
    """Every mask and method without occlusion against the truth, float32 against float64 with every kind of
    occlusion, and the derivatives."""
    for name, mask in MASKS.items():
        camera = camera_with(mask)
        height = free_height(camera)
        truth = true_photo(hard.view, camera, height)
        for method in hard.methods:
            yield from _method(hard, camera, height, truth, f"{method}, {name}", method)
        for occlusion in OCCLUSIONS:
            yield from _occlusion(hard, camera, height, f"{occlusion}, {name}", occlusion)
        yield timed(f"gradient, {name}", SINGLE, lambda c=camera, h=height: _gradient(hard, c, h))


def _photo(hard: HardView, camera: Camera, height: Tensor | None, dtype: torch.dtype, **how: Any) -> Tensor:
    made = expose(
        hard.view, camera, height=height, exposure=1.0, effects=QUIET, dtype=dtype, **{**hard.options, **how}
    )
    return made.clean.double()


def _method(
    hard: HardView, camera: Camera, height: Tensor | None, truth: Tensor, way: str, method: str
) -> Iterator[Finding]:
    found: list[Tensor] = []

    def double() -> float:
        found.append(_photo(hard, camera, height, torch.float64, method=method, occlusion="none"))
        return deviation(found[0], truth)

    yield timed(f"{way}, float64", hard.layered, double)
    yield timed(
        f"{way}, float32",
        hard.single,
        lambda: distance(
            _photo(hard, camera, height, torch.float32, method=method, occlusion="none"), found[0]
        ),
    )


def _occlusion(
    hard: HardView, camera: Camera, height: Tensor | None, way: str, occlusion: str
) -> Iterator[Finding]:
    found: list[Tensor] = []

    def double() -> float:
        found.append(_photo(hard, camera, height, torch.float64, occlusion=occlusion))
        brightest = float(hard.view.all_in_focus().max())
        hidden = hard.view.radiance[:, hard.view.hidden]
        if hidden.numel():
            coverage = hard.view.coverage[hard.view.hidden].clamp_min(1e-300)
            brightest = max(brightest, float((hidden / coverage).max()))
        excess = float((found[0].amax() - brightest).clamp_min(0) / max(brightest, 1e-300))
        return excess + float((-found[0].amin()).clamp_min(0)) / max(brightest, 1e-300)

    yield timed(f"{way}, light, float64", 1e-3, double)
    yield timed(
        f"{way}, float32",
        hard.single,
        lambda: distance(_photo(hard, camera, height, torch.float32, occlusion=occlusion), found[0]),
    )


def _gradient(hard: HardView, camera: Camera, height: Tensor | None) -> float:
    """Derivatives of a weighted sum of the photo with hidden surfaces by radiance and height, float32 against
    float64."""
    grads = []
    for dtype in (torch.float64, torch.float32):
        radiance = hard.view.radiance.detach().clone().to(dtype).requires_grad_()
        lever = None if height is None else height.detach().clone().to(dtype).requires_grad_()
        photo = expose(
            replace(hard.view, radiance=radiance),
            camera,
            height=lever,
            exposure=1.0,
            effects=QUIET,
            dtype=dtype,
            **hard.options,
        ).clean
        pattern = uniform(*photo.shape, seed=3).to(dtype)
        (photo * pattern).sum().backward()
        grads.append([each.grad.double() for each in (radiance, lever) if each is not None])
    return max(distance(single, double) for double, single in zip(*grads, strict=True))


def distance(image: Tensor, truth: Tensor) -> float:
    """Largest difference relative to the largest value; NaN where anything is not finite."""
    if not bool(torch.isfinite(image).all() and torch.isfinite(truth).all()):
        return float("nan")
    scale = float(truth.abs().max())
    return float((image - truth).abs().max()) / scale if scale > 0 else float(image.abs().max())


def deviation(image: Tensor, truth: Tensor) -> float:
    """Root mean square difference relative to the largest value; NaN where anything is not finite."""
    if not bool(torch.isfinite(image).all() and torch.isfinite(truth).all()):
        return float("nan")
    scale = float(truth.abs().max())
    error = image - truth
    size = float(error.abs().max())
    # squares of the largest numbers overflow, of the smallest vanish
    return 0.0 if size == 0 else size * float((error / size).square().mean().sqrt()) / (scale or 1.0)


def photo_case(
    name: str, group: str, physics: str, risk: str, expected: str, make: Callable[[], HardView]
) -> Case:
    """A case whose check is `findings` of what `make` makes."""
    return Case(name, group, physics, risk, expected, lambda: findings(make()))
