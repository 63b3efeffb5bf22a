"""Photos of hard views, through every camera and precision, against photos that are written out
(`true_photos`), in float32 as in float64.

Errors are relative to the local value, or to the sensor's noise where that is more (`measures`): a pixel
next to a lamp counts as much as the lamp. float32, bfloat16 and derivatives are compared with the code itself
in float64, and such findings are marked `alike`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace

import torch
from torch import Tensor

from ..capture import Fidelity, capture
from ..optics import Camera
from ..render.view import View
from . import true_photos
from .case import Cameras, Case, Finding, timed
from .measures import distance, typical, worst
from .true_photos import Source
from .views import uniform

SUB_APERTURES = 3
"""Along each axis of the pupil, where something is hidden."""
SHIPPED: Mapping[str, object] = {"layers_db": 50.0}
"""How accurately depth nodes are asked for, unless a case says otherwise."""

SINGLE = 5e-4
"""float32 against float64, at the worst pixel: 1.3e-4 were seen, next to a lamp of 1e12."""
EXACT = 1e-3
"""Against the photo written out, at the worst pixel, where nothing is interpolated over depth: 2e-4 were
seen, which is what pixels integrate from 2 x 2 samples (`transform.pixel_weights`). 1 % of anything shows."""
LAYERED = 0.01
"""Root mean square over the frame, where depths are interpolated: the 40 dB that are left of 50 dB for
natural images where a view is white noise."""
GROUPED = 0.05
"""Likewise with bands in two groups of two wavelengths each: spectra of white noise are as far from smooth
as they can be."""

SLOPE = 1e-5
"""Derivatives in float64 against what they stand for."""
STEP = 1e-10
"""Of a height in metres: a central difference over it is right to 1e-6."""
FEW = 3
"""Depths that every method has a node of its own for."""


@dataclass(frozen=True)
class HardView:
    """view: in the pixels of any camera.
    exact, layered: bounds in place of EXACT and LAYERED.
    options: fields of `Fidelity`.
    cut: inverse depth [1/m] between a surface and what it hides, None where nothing is hidden.
    """

    view: View
    exact: float = EXACT
    layered: float = LAYERED
    options: Mapping[str, object] = field(default_factory=dict)
    cut: float | None = None

    @property
    def nodes(self) -> Tensor:
        """Depth nodes [node] that layers are composited at: the view's depths, or four that lie
        unevenly, so that no depth is halfway between two."""
        depths = torch.unique(self.view.inverse_depth.double())
        if len(depths) <= FEW:
            return depths
        places = torch.tensor([0.0, 0.317, 0.643, 1.0], dtype=torch.float64)
        return depths[0] + places * (depths[-1] - depths[0])

    @property
    def few(self) -> bool:
        return len(torch.unique(self.view.inverse_depth)) <= FEW


def findings(hard: HardView, cameras: Mapping[str, Camera], source: Source) -> Iterator[Finding]:
    """Every camera, precision and kind of occlusion against the truth, and the derivatives."""
    for name, camera in cameras.items():
        seen = replace(hard, view=replace(hard.view, pixel_angle=camera.pixel_angle))
        yield from _of_camera(seen, camera, name, source)


def _of_camera(hard: HardView, camera: Camera, name: str, source: Source) -> Iterator[Finding]:
    truth = true_photos.linear(hard.view, camera, source)
    yield from _layered(hard, camera, truth, name)
    yield from _occlusions(hard, camera, truth, name, source)
    if camera.height_map is not None:
        yield timed(f"slope by height, {name}", SLOPE, lambda c=camera: _slope(hard, c), alike=True)
    yield timed(f"gradient, {name}", SINGLE, lambda c=camera: _gradient(hard, c), alike=True)


def _photo(
    hard: HardView, camera: Camera, dtype: torch.dtype, how: Mapping[str, object], nodes: Tensor | None = None
) -> Tensor:
    fidelity = Fidelity().changed({**SHIPPED, **hard.options, **how})
    return capture(hard.view, camera, fidelity, exposure=1.0, dtype=dtype, nodes=nodes).clean.double()


def _judged(
    way: str,
    bound: float,
    make: Callable[[torch.dtype], Tensor],
    truth: Tensor | None,
    measure: Callable[[Tensor, Tensor], float] = worst,
) -> Iterator[Finding]:
    """float64 and float32 against the truth, if there is one, and against each other."""
    double: list[Tensor] = []
    single: list[Tensor] = []

    def judge(dtype: torch.dtype, kept: list[Tensor], against: Tensor) -> float:
        kept.append(make(dtype))
        return measure(kept[0], against)

    if truth is not None:
        yield timed(f"{way}, float64", bound, lambda: judge(torch.float64, double, truth))
        yield timed(f"{way}, float32", bound, lambda: judge(torch.float32, single, truth))
    else:
        double.append(make(torch.float64))
        single.append(make(torch.float32))
    yield timed(f"{way}, float32 against float64", SINGLE, lambda: worst(single[0], double[0]), alike=True)


def _layered(hard: HardView, camera: Camera, truth: Tensor, mask: str) -> Iterator[Finding]:
    how: dict[str, object] = {"occlusion": "none"}
    way = f"layered, {mask}"
    if not hard.few:
        bound, measure = hard.layered, typical
    else:
        bound, measure = hard.exact, worst
    yield from _judged(way, bound, lambda dtype: _photo(hard, camera, dtype, how), truth, measure)

    def mixed() -> float:
        with torch.autocast("cpu", torch.bfloat16):
            return worst(_photo(hard, camera, torch.float32, how), _photo(hard, camera, torch.float64, how))

    def adjoint() -> float:
        # a photo is linear in the light: its derivative, applied to the light itself, is the photo
        radiance = hard.view.radiance.detach().clone().requires_grad_()
        lit = replace(hard, view=replace(hard.view, radiance=radiance))
        photo = _photo(lit, camera, torch.float64, how)
        pattern = uniform(*photo.shape, seed=3)
        (slope,) = torch.autograd.grad((photo * pattern).sum(), radiance)
        return distance((slope * radiance.detach()).sum()[None], (photo.detach() * pattern).sum()[None])

    yield timed(f"{way}, mixed precision against float64", SINGLE, mixed, alike=True)
    yield timed(f"{way}, gradient, float64", SLOPE, adjoint, alike=True)


def _occlusions(
    hard: HardView, camera: Camera, linear: Tensor, mask: str, source: Source
) -> Iterator[Finding]:
    nodes = hard.nodes
    for occlusion, written in (("over", true_photos.over), ("normalised", true_photos.normalised)):
        truth = written(hard.view, camera, nodes.tolist(), source)
        how: dict[str, object] = {"occlusion": occlusion}
        yield from _judged(
            f"{occlusion}, {mask}",
            hard.exact,
            lambda dtype, how=how: _photo(hard, camera, dtype, how, nodes),
            truth,
        )
    uncovered = linear if hard.cut is None else true_photos.uncovered(hard.view, camera, hard.cut, source)
    bound, measure = (hard.exact, worst) if hard.few else (hard.layered, typical)
    yield from _judged(
        f"hidden, {mask}",
        bound,
        lambda dtype: _photo(hard, camera, dtype, {"occlusion": "hidden"}),
        uncovered,
        measure,
    )
    how = {"band_groups": 2, "group_wavelengths": 2, "occlusion": "hidden"}
    yield from _judged(
        f"hidden in groups of bands, {mask}",
        max(GROUPED, bound),
        lambda dtype: _photo(hard, camera, dtype, how),
        uncovered,
        typical,
    )
    if bool(hard.view.hidden.any()):
        across = SUB_APERTURES
        part = {"sub_apertures": across, "occlusion": "hidden"}
        yield from _judged(
            f"hidden through {across} x {across} sub-apertures, {mask}",
            SINGLE,
            lambda dtype: _photo(hard, camera, dtype, part),
            None,
        )


def _gradient(hard: HardView, camera: Camera) -> float:
    """Derivatives of a weighted sum of the photo with hidden surfaces by radiance and height, float32 against
    float64."""
    grads: list[list[Tensor]] = []
    for dtype in (torch.float64, torch.float32):
        radiance = hard.view.radiance.detach().clone().to(dtype).requires_grad_()
        height = camera.height_map
        lever = None if height is None else height.detach().clone().to(dtype).requires_grad_()
        lit = replace(hard, view=replace(hard.view, radiance=radiance))
        photo = _photo(lit, camera.with_height(lever), dtype, {})
        by = [radiance] if lever is None else [radiance, lever]
        found = torch.autograd.grad((photo * uniform(*photo.shape, seed=3)).sum(), by)
        grads.append([each.double() for each in found])
    return max(distance(single, double) for double, single in zip(*grads, strict=True))


def _slope(hard: HardView, camera: Camera) -> float:
    """The derivative by height along a random direction against a central difference, float64; relative to
    the largest that a direction of that length can have."""
    height = camera.height_map
    assert height is not None
    lever = height.detach().clone().requires_grad_()
    pattern = uniform(3, hard.view.height, hard.view.width, seed=3)

    def weighed(at: Tensor) -> Tensor:
        photo = _photo(hard, camera.with_height(at), torch.float64, {})
        return (photo * pattern).sum()

    (slope,) = torch.autograd.grad(weighed(lever), lever)
    step = STEP * (2 * uniform(*height.shape, seed=7) - 1)
    difference = float(weighed(height + step) - weighed(height - step)) / 2
    most = float(slope.norm() * step.norm())
    return abs(difference - float((slope * step).sum())) / most if most > 0 else abs(difference)


Row = tuple[str, str, str, Callable[[Camera], HardView]]
"""Name, physics, risk and view of a case. The view may go by the camera's focus."""


def photo_cases(
    group: str, expected: str, rows: Iterable[Row], cameras: Cameras, source: Source
) -> tuple[Case, ...]:
    """Cases of a group whose check is `findings`."""

    def check(make: Callable[[Camera], HardView]) -> Iterator[Finding]:
        through = cameras()
        return findings(make(next(iter(through.values()))), through, source)

    return tuple(
        Case(name, group, physics, risk, expected, lambda m=make: check(m))
        for name, physics, risk, make in rows
    )
