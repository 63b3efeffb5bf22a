"""Cameras drawn at random, for a network that restores the photos of any camera.

Each has a lens, a focus, a sensor, a mask and a depth range of its own; what they are drawn from are the
ranges of the recipe's table `cameras`. The same seed and number give the same camera.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from ..capture.prepare import blur_per_dioptre
from ..errors import EdofsimError, InputError
from ..optics import Camera
from ..optics.height import designed_map
from ..optics.masks.height_map import HeightMapMask
from ..recipe.camera import CameraRecipe
from ..recipe.load import load_camera
from ..recipe.train import CamerasTable
from .doe import metres_per_radian
from .schedule import generator_of

CAMERAS = 7  # purpose of random numbers
TRIES = 1000
MASK_SAMPLES = 160  # of a drawn height map across the pupil
DESIGNED = "paper-learned"  # whose height map is taken, turned, for some


@dataclass(frozen=True)
class RandomCamera:
    """camera: with its mask.
    depths: least and largest inverse depth that it photographs, in 1/m.
    broadband: whether its sensor adds up all wavelengths or sees three lines.
    read_noise: relative to full scale.
    """

    camera: Camera
    depths: tuple[float, float]
    broadband: bool
    read_noise: float


def random_camera(
    table: CamerasTable, seed: int, number: int, attempt: int, noise: tuple[float, float]
) -> RandomCamera:
    """The camera of that number, or another in its place.

    noise: range of its read noise.

    Raises InputError for ranges that hold none that can be.
    """
    generator = generator_of(seed, CAMERAS, number, attempt)

    def even(low: float, high: float) -> float:
        return low + (high - low) * float(torch.rand((), generator=generator))

    def ratio(low: float, high: float) -> float:
        return low * (high / low) ** even(0, 1)

    for _ in range(TRIES):
        found = _drawn(table, even, ratio, number, noise)
        least, most = table.blur_px
        if found is None or not least <= widest_blur_px(found) <= most:
            continue
        if isinstance(found.camera.mask, HeightMapMask):
            return _with_height_map(found, table, even, generator)
        return found
    raise InputError("cameras: no camera within these ranges blurs as blur_px asks for; widen them")


def widest_blur_px(drawn: RandomCamera) -> float:
    """Diameter in pixels of the largest geometric blur over the depth range, without mask."""
    camera = drawn.camera
    focus = 1 / camera.recipe.focus.distance_m
    away = max(abs(depth - focus) for depth in drawn.depths)
    return blur_per_dioptre(camera) * away


def _drawn(
    table: CamerasTable,
    even: Callable[[float, float], float],
    ratio: Callable[[float, float], float],
    number: int,
    noise: tuple[float, float],
) -> RandomCamera | None:
    """One try, without its height map where that is free; None where there can be no such lens."""
    focal, stop = ratio(*table.focal_length_mm), ratio(*table.f_number)
    lens: dict[str, object] = {"kind": table.lenses[int(even(0, len(table.lenses)))]}
    if lens["kind"] == "plano-convex":
        lens |= {"radius_of_curvature_mm": 0.4585 * focal, "aperture_radius_mm": focal / stop / 2}
    else:
        lens |= {"focal_length_mm": focal, "f_number": stop}
    far = max(0.0, even(-table.nearest_per_m[0], table.nearest_per_m[0]))
    near = even(far + 0.4, max(far + 0.4, table.nearest_per_m[1]))
    kind = table.masks[number % len(table.masks)]
    nearest, farthest = table.focus_distance_m
    values = {
        "name": f"random-{number}",
        "lens": lens,
        "focus": {"distance_m": 1 / even(1 / farthest, 1 / nearest), "plane": "best"},
        "mask": _mask(kind, ratio(*table.strength_rad), even),
        "sensor": {"pixel_um": ratio(*table.pixel_um), "read_noise": ratio(*noise)},
        "psf": {"window_px": table.window_px},
    }
    broadband = even(0, 1) < table.broadband
    try:
        camera = Camera.from_recipe(CameraRecipe.model_validate(values))
    except (EdofsimError, ValueError):
        return None
    return RandomCamera(camera, (far, near), broadband, camera.read_noise)


def _mask(kind: str, strength: float, even: Callable[[float, float], float]) -> dict[str, object]:
    """A mask of that kind, about as strong as `strength` in radians."""

    def signed(scale: float) -> float:
        return even(-scale, scale)

    if kind in ("cubic", "logarithmic", "sinusoidal", "tangent"):
        return {"kind": kind, "alpha_rad": strength if even(0, 1) < 0.5 else -strength}
    if kind == "rings":
        edges = sorted(even(0.2, 0.95) for _ in range(2))
        radii = zip((edges[0], edges[1] + 1e-3), (edges[1], 1.0), strict=True)
        rings = [{"inner_radius": a, "outer_radius": b, "phase_rad": even(2, 14)} for a, b in radii if b > a]
        return {"kind": kind, "rings": rings}
    if kind == "zernike":
        terms = [{"noll": n, "rms_rad": signed(strength / 10)} for n in range(5, 16)]
        return {"kind": kind, "terms": terms}
    if kind == "fourier":
        orders = [(p, q) for p in range(3) for q in range(-2, 3) if (p, q) > (0, 0)]
        return {
            "kind": kind,
            "terms": [
                {"p": p, "q": q, "cosine_rad": signed(strength / 8), "sine_rad": signed(strength / 8)}
                for p, q in orders
            ],
        }
    if kind == "annular":
        return {"kind": kind, "inner_radius": even(0.2, 0.7)}
    return {"kind": kind}


def _with_height_map(
    drawn: RandomCamera,
    table: CamerasTable,
    even: Callable[[float, float], float],
    generator: torch.Generator,
) -> RandomCamera:
    """With a height map: half of the maps are the designed one, turned and stretched, the others random."""
    camera = drawn.camera
    if even(0, 1) < 0.5:
        shipped = load_camera(DESIGNED)
        found = designed_map(Camera.from_recipe(shipped.recipe, shipped.base))
        assert found is not None
        height = torch.rot90(found[0], int(even(0, 4)), (0, 1))
        height = height.flip(0) if even(0, 1) < 0.5 else height
    else:
        strength = even(*table.strength_rad) / 2
        wavelength = HeightMapMask().design_wavelength_nm * 1e-9
        radian = metres_per_radian(float(camera.mask_material.index(wavelength)), wavelength)
        height = strength * radian * _smooth(MASK_SAMPLES, even(1.5, 4), generator)
    pitch = 2e6 * camera.aperture_radius / len(height) * (1 + 1e-9)
    mask = HeightMapMask(pitch_um=pitch)
    recipe = camera.recipe.model_copy(update={"mask": mask})
    own = Camera.from_recipe(recipe, camera.base).with_height(height - height.min())
    return RandomCamera(own, drawn.depths, drawn.broadband, drawn.read_noise)


def _smooth(cells: int, cycles: float, generator: torch.Generator) -> Tensor:
    """A random surface [cells, cells] of variance 1 whose details are up to about `cycles` a diameter."""
    noise = torch.randn(cells, cells, generator=generator, dtype=torch.float64)
    frequency = torch.fft.fftfreq(cells, 1 / cells)
    squared = (frequency[:, None].square() + frequency[: cells // 2 + 1].square()).double()
    kept = torch.fft.rfft2(noise) * (-squared / (2 * cycles**2)).exp()
    surface = torch.fft.irfft2(kept, s=(cells, cells))
    return (surface - surface.mean()) / surface.std()
