"""Photos of hard views, through every method, mask and precision.

The truth of a photo without occlusion is made here once more, by the simplest means: each fragment's own PSF
in float64, whole-image convolutions of each depth and band one by one, no layers, no tiles, no batches. With
occlusion no closed form exists for any view; there the photo must be finite, hold no more light than there
is, and agree in float32 and float64.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import torch
from scipy.signal import fftconvolve
from torch import Tensor

from ..capture import Fidelity, capture
from ..optics import Camera, psf_bank, response
from ..render.view import View
from .case import Case, Finding, timed
from .views import MASKS, WINDOW, camera_with, uniform, with_free_height

METHODS = ("brute", "layered")
OCCLUSIONS = ("over", "normalised", "hidden")
SUB_APERTURES = 3
"""Along each axis of the pupil, where something is hidden."""
SHIPPED: Mapping[str, Any] = {"layers_db": 50.0}
"""How accurately depth nodes are asked for, unless a case says otherwise."""

SINGLE = 1e-4
"""float32 against float64, relative to the brightest value of the photo."""

LAYERED = 0.01
"""Photos in layers against each fragment's own PSF: root mean square error relative to the brightest value,
40 dB. The views are of white noise, for which the methods' tolerance (of natural images) does not speak."""
SLOPE = 1e-5
"""Derivatives in float64 against what they stand for."""
STEP = 1e-10
"""Of a height in metres: a central difference over it is right to 1e-6."""


@dataclass(frozen=True)
class HardView:
    """view: through `camera_with(mask)`; layered: a bound in place of LAYERED; options: fields of `Fidelity`;
    methods: those that apply."""

    view: View
    layered: float = LAYERED
    options: Mapping[str, Any] = field(default_factory=dict)
    methods: tuple[str, ...] = METHODS


def true_photo(view: View, camera: Camera) -> Tensor:
    """Clean photo without occlusion, float64 [channel, y, x]: see the module's text."""
    rows, columns = view.padded_shape
    seen = ~view.hidden
    depths, member = torch.unique(view.inverse_depth[seen], return_inverse=True)
    weights = response(camera, view.wavelengths).double()
    out = np.zeros((3, rows, columns))
    for number, depth in enumerate(depths):
        psf = psf_bank(camera, view.wavelengths, depth[None], dtype=torch.float64).values[0]
        image = torch.zeros(view.bands, rows * columns, dtype=torch.float64)
        which = member == number
        image.index_add_(1, view.pixel[seen][which], view.radiance[:, seen][:, which])
        for band in range(view.bands):
            plane = image[band].reshape(rows, columns).numpy()
            start = (WINDOW - 1) // 2
            whole = fftconvolve(plane, psf[band].numpy(), mode="full")
            first = WINDOW - 1 - start
            blurred = whole[first : first + rows, first : first + columns]
            glare = float(1 - psf[band].sum()) * plane.mean()  # of what lands beyond the window
            out += weights[:, band, None, None].numpy() * (blurred + glare)
    return view.crop_margin(torch.from_numpy(out))


def findings(hard: HardView) -> Iterator[Finding]:
    """Every mask and method without occlusion against the truth, float32 and mixed precision against float64
    with every kind of occlusion, and the derivatives."""
    for name, mask in MASKS.items():
        camera = with_free_height(camera_with(mask))
        truth = true_photo(hard.view, camera)
        for method in hard.methods:
            yield from _method(hard, camera, truth, f"{method}, {name}", method, hard.layered)
        for occlusion in OCCLUSIONS:
            yield from _occlusion(hard, camera, f"{occlusion}, {name}", occlusion=occlusion)
        if bool(hard.view.hidden.any()):
            across = SUB_APERTURES
            way = f"hidden through {across} x {across} sub-apertures"
            how = {"occlusion": "hidden", "sub_apertures": across}
            yield from _occlusion(hard, camera, f"{way}, {name}", **how)
            yield from _occlusion(hard, camera, f"{way} in full, {name}", **how, sub_apertures_in_full=True)
        how = {"band_groups": 2, "group_wavelengths": 2, "occlusion": "hidden"}
        yield from _occlusion(hard, camera, f"hidden in groups of bands, {name}", **how)
        yield timed(f"gradient, {name}", SINGLE, lambda c=camera: _gradient(hard, c))
        if camera.height_map is not None:
            yield timed(f"slope by height, {name}", SLOPE, lambda c=camera: _slope(hard, c))


def _photo(hard: HardView, camera: Camera, dtype: torch.dtype, **how: Any) -> Tensor:
    fidelity = Fidelity(**{**SHIPPED, **hard.options, **how})
    return capture(hard.view, camera, fidelity, exposure=1.0, dtype=dtype).clean.double()


def _method(
    hard: HardView,
    camera: Camera,
    truth: Tensor,
    way: str,
    method: str,
    bound: float,
) -> Iterator[Finding]:
    found: list[Tensor] = []
    how = {"method": method, "occlusion": "none"}

    def double() -> float:
        found.append(_photo(hard, camera, torch.float64, **how))
        return deviation(found[0], truth)

    def single() -> float:
        return distance(_photo(hard, camera, torch.float32, **how), found[0])

    def mixed() -> float:
        with torch.autocast("cpu", torch.bfloat16):
            return single()

    def adjoint() -> float:
        # a photo is linear in the light: its derivative, applied to the light itself, is the photo
        radiance = hard.view.radiance.detach().clone().requires_grad_()
        lit = replace(hard, view=replace(hard.view, radiance=radiance))
        pattern = uniform(*found[0].shape, seed=3)
        (_photo(lit, camera, torch.float64, **how) * pattern).sum().backward()
        return distance((radiance.grad * radiance.detach()).sum()[None], (found[0] * pattern).sum()[None])

    yield timed(f"{way}, float64", bound, double)
    yield timed(f"{way}, float32", SINGLE, single)
    yield timed(f"{way}, mixed", SINGLE, mixed)
    yield timed(f"{way}, gradient, float64", SLOPE, adjoint)


def _occlusion(hard: HardView, camera: Camera, way: str, **how: Any) -> Iterator[Finding]:
    found: list[Tensor] = []

    def double() -> float:
        found.append(_photo(hard, camera, torch.float64, **how))
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
        SINGLE,
        lambda: distance(_photo(hard, camera, torch.float32, **how), found[0]),
    )


def _gradient(hard: HardView, camera: Camera) -> float:
    """Derivatives of a weighted sum of the photo with hidden surfaces by radiance and height, float32 against
    float64."""
    grads = []
    for dtype in (torch.float64, torch.float32):
        radiance = hard.view.radiance.detach().clone().to(dtype).requires_grad_()
        height = camera.height_map
        lever = None if height is None else height.detach().clone().to(dtype).requires_grad_()
        lit = replace(hard, view=replace(hard.view, radiance=radiance))
        photo = _photo(lit, camera.with_height(lever), dtype)
        (photo * uniform(*photo.shape, seed=3)).sum().backward()
        grads.append([each.grad.double() for each in (radiance, lever) if each is not None])
    return max(distance(single, double) for double, single in zip(*grads, strict=True))


def _slope(hard: HardView, camera: Camera) -> float:
    """The derivative by height along a random direction against a central difference, float64; relative to
    the largest that a direction of that length can have."""
    height = camera.height_map
    assert height is not None
    lever = height.detach().clone().requires_grad_()
    pattern = uniform(3, hard.view.height, hard.view.width, seed=3)

    def weighed(at: Tensor) -> Tensor:
        return (_photo(hard, camera.with_height(at), torch.float64, method="layered") * pattern).sum()

    weighed(lever).backward()
    step = STEP * (2 * uniform(*height.shape, seed=7) - 1)
    difference = float(weighed(height + step) - weighed(height - step)) / 2
    most = float(lever.grad.norm() * step.norm())
    return abs(difference - float((lever.grad * step).sum())) / most if most > 0 else abs(difference)


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


def photo_cases(
    group: str, expected: str, rows: Iterable[tuple[str, str, str, Callable[[], HardView]]]
) -> tuple[Case, ...]:
    """Cases of a group from rows of (name, physics, risk, view)."""
    return tuple(photo_case(name, group, physics, risk, expected, make) for name, physics, risk, make in rows)
