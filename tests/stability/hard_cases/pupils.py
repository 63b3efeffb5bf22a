"""Hard pupils: point spread functions where the sampling, the relief or the grid is extreme.

Bounds are of the PSF's values relative to its brightest; all light is the window's and the rest's together.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import partial
from typing import Literal

import torch
from torch import Tensor

from edofsim.errors import InputError
from edofsim.optics import Camera, PsfField, defocus, plan_sampling, psf_bank
from edofsim.optics.lenses.plano_convex import PlanoConvexLens
from edofsim.optics.masks import Mask
from edofsim.optics.masks.clear import ClearMask
from edofsim.optics.masks.coded import CodedMask
from edofsim.optics.masks.cubic import CubicMask
from edofsim.optics.masks.height_map import HeightMapMask
from edofsim.recipe.camera import CameraRecipe, PsfSettings
from edofsim.stability.case import Case, Finding, timed
from edofsim.stability.measures import distance
from edofsim.stability.views import MASKS, camera_with, uniform, with_free_height

GREEN = torch.tensor([543e-9], dtype=torch.float64)
SIDE = 25
PRECISIONS = (torch.float64, torch.float32)


def bank(
    camera: Camera,
    inverse_depth: float,
    dtype: torch.dtype = torch.float64,
    side: int = SIDE,
) -> PsfField:
    """The PSF of one green wavelength at one depth."""
    return psf_bank(camera, GREEN, [inverse_depth], window_px=side, dtype=dtype)


def name_of(dtype: torch.dtype) -> str:
    return str(dtype).removeprefix("torch.")


def whole(found: PsfField) -> float:
    """How far window and rest together are from all light, and how far below zero either reaches; NaN where
    something is not finite."""
    values, truncated = found.values.double(), found.truncated.double()
    below = torch.stack([-values.min(), -truncated.min()]).max().clamp_min(0)
    return float((values.sum((-1, -2)) + truncated - 1).abs().max() + below) + 0 * float(values.sum())


def camera_of(
    aperture_mm: float,
    mask: Mask | None = None,
    pupil_um: float | None = None,
    oversampling: int = 1,
    surface_profile: Literal["spherical", "parabolic"] = "spherical",
) -> Camera:
    """The paper's lens with another aperture and, if wanted, pupil sampling and a parabola in place of the
    sphere.

    oversampling: 1 is right for blurs much wider than a pixel."""
    psf = PsfSettings(window_px=SIDE, oversampling=oversampling, pupil_sampling_um=pupil_um or "auto")
    lens = PlanoConvexLens(aperture_radius_mm=aperture_mm, surface_profile=surface_profile)
    return Camera.from_recipe(CameraRecipe(name="hard", lens=lens, mask=mask or ClearMask(), psf=psf))


def depth_of_psi(camera: Camera, psi: float) -> float:
    """Inverse depth whose defocus at GREEN is psi: it is linear in 1/z."""
    at_zero, at_one = (float(defocus(camera, GREEN, torch.tensor([d]))) for d in (0.0, 1.0))
    return (psi - at_zero) / (at_one - at_zero)


def _strong_defocus(psi: float) -> Callable[[], Iterator[Finding]]:
    def check() -> Iterator[Finding]:
        camera = camera_of(2.5)
        depth = depth_of_psi(camera, psi)
        pair: list[PsfField] = []

        def energy() -> float:
            pair.append(bank(camera, depth))
            return whole(pair[0])

        yield timed("energy, float64", 1e-6, energy)
        yield timed(
            "float32",
            1e-4,
            lambda: distance(bank(camera, depth, torch.float32).values.double(), pair[0].values),
        )
        yield timed("light in the window, float64", 0.05, lambda: _off_geometry(psi))
        if psi > 500:
            return  # a finer pupil would be larger than the largest that is computed
        grid = plan_sampling(camera, GREEN, pair[0].inverse_depths, SIDE)
        finer = camera_of(2.5, pupil_um=0.8 * grid.pitch * 1e6)
        yield timed(
            "against a finer pupil, float64",
            0.02,
            lambda: distance(pair[0].values, bank(finer, depth).values),
        )

    return check


def _off_geometry(psi: float) -> float:
    """Light in a window within the blur against that of an even disc, whose radius is r z_i times the defocus
    in dioptres, psi lambda / (pi r^2)."""
    camera = camera_of(2.5, surface_profile="parabolic")
    dioptres = psi * float(GREEN) / (math.pi * camera.aperture_radius**2)
    radius = camera.aperture_radius * camera.sensor_distance * dioptres
    share = (SIDE * camera.pixel) ** 2 / (math.pi * radius**2)
    return abs(float(bank(camera, depth_of_psi(camera, psi)).values.sum()) / share - 1)


def _relief(change: Callable[[Tensor, Camera], Tensor], bound: float) -> Callable[[], Iterator[Finding]]:
    """A free mask against the same mask after a change that light does not see."""

    def check() -> Iterator[Finding]:
        camera = with_free_height(camera_with(MASKS["free"]))
        other = change(_height(camera), camera)
        truth = bank(camera, 0.3).values
        changed = camera.with_height(other)
        yield timed("float64", bound, lambda: distance(bank(changed, 0.3).values, truth))
        yield timed(
            "float32",
            max(bound, 1e-4),
            lambda: distance(
                bank(camera.with_height(other.float()), 0.3, torch.float32).values.double(), truth
            ),
        )

    return check


def _height(camera: Camera) -> Tensor:
    assert camera.height_map is not None
    return camera.height_map


def _wave(camera: Camera) -> float:
    """Height of the mask's material that delays green light by a wave, in metres."""
    height_map = camera.mask_material
    return float(GREEN) / (float(height_map.index(GREEN)) - 1)


def _random_heights() -> Iterator[Finding]:
    camera = with_free_height(camera_with(MASKS["free"]))
    height = uniform(*_height(camera).shape, seed=5) * _wave(camera)
    for dtype in PRECISIONS:
        yield timed(
            f"energy, {name_of(dtype)}",
            1e-4,
            lambda dtype=dtype: whole(bank(camera.with_height(height.to(dtype)), 0.3, dtype)),
        )


def _no_light() -> Iterator[Finding]:
    def said() -> float:
        try:
            CodedMask(pattern=("00", "00"))
        except ValueError as error:
            return 0.0 if "no light" in str(error) else 1.0
        return 1.0

    yield timed("recipe, message", 0.0, said)


def _one_sample() -> Iterator[Finding]:
    camera = camera_with(HeightMapMask(pitch_um=1200.0))
    flat = torch.full((1, 1), 3e-7, dtype=torch.float64)
    truth = bank(camera_with(ClearMask()), 0.3).values
    yield timed(
        "against no mask, float64", 1e-3, lambda: distance(bank(camera.with_height(flat), 0.3).values, truth)
    )


def _windows() -> Iterator[Finding]:
    camera = camera_with(CubicMask(alpha_rad=6.0))
    truth = bank(camera, 0.3, side=33).values[0, 0]
    for side in (1, 2, 24, 25, 32):
        first = 16 - side // 2
        part = truth[first : first + side, first : first + side]
        yield timed(
            f"window {side}, float64",
            1e-6,
            lambda side=side, part=part: distance(bank(camera, 0.3, side=side).values[0, 0], part),
        )


def _replicas() -> Iterator[Finding]:
    """A pupil so coarse that copies of the PSF lie in the window."""
    camera = camera_of(2.5, pupil_um=300.0)

    def said() -> float:
        try:
            bank(camera, 0.0, side=257)
        except InputError as error:
            return 0.0 if "um" in str(error) else 1.0
        return 1.0

    yield timed("message", 0.0, said)


def _mirrored() -> Iterator[Finding]:
    """A mask upside down has its PSF upside down."""
    camera = with_free_height(camera_with(MASKS["free"]))
    height = _height(camera)
    truth = bank(camera.with_height(height), 0.3).values
    for name, axis in (("rows", -2), ("columns", -1)):
        yield timed(
            f"{name}, float64",
            1e-6,
            lambda axis=axis: distance(
                bank(camera.with_height(height.flip(axis)), 0.3).values.flip(axis), truth
            ),
        )


def _both_sides_of_focus() -> Iterator[Finding]:
    """A clear aperture with a parabolic lens cannot tell near from far."""
    recipe = camera_with(ClearMask()).recipe
    lens = recipe.lens.model_copy(update={"surface_profile": "parabolic"})
    camera = Camera.from_recipe(recipe.model_copy(update={"lens": lens}))
    for psi in (0.5, 1.2):
        yield timed(
            f"psi {psi:g}, float64",
            1e-6,
            lambda psi=psi: distance(
                bank(camera, depth_of_psi(camera, psi)).values,
                bank(camera, depth_of_psi(camera, -psi)).values,
            ),
        )


def _extreme_distances() -> Iterator[Finding]:
    for name, mask in MASKS.items():
        camera = with_free_height(camera_with(mask))
        for distance_m in (math.inf, 1e12, 1e9, 0.05):
            for dtype in PRECISIONS:
                made = partial(bank, camera, 1 / distance_m, dtype)
                yield timed(f"{distance_m:g} m, {name}, {name_of(dtype)}", 1e-4, lambda m=made: whole(m()))


CASES: tuple[Case, ...] = (
    Case(
        "psi 100",
        "pupil",
        "twice the paper's defocus",
        "aliased phase",
        "all light, as with a finer pupil",
        _strong_defocus(100.0),
    ),
    Case(
        "psi 1000",
        "pupil",
        "twenty times the paper's defocus",
        "aliased phase",
        "all light",
        _strong_defocus(1000.0),
    ),
    Case(
        "hundreds of waves",
        "pupil",
        "a plate 500 waves thick below the relief",
        "phase beyond single precision",
        "the relief's own PSF",
        _relief(lambda h, c: h + 500 * _wave(c), 1e-6),
    ),
    Case(
        "a millimetre thick",
        "pupil",
        "a plate of 1000 waves and a fraction",
        "phase beyond single precision",
        "the relief's own PSF",
        _relief(lambda h, c: h + 1000.37 * _wave(c), 1e-6),
    ),
    Case(
        "wrapped",
        "pupil",
        "heights modulo one wave at 543 nm",
        "steps of the map smoothed into ramps",
        "the unwrapped PSF",
        _relief(lambda h, c: h - torch.floor(h / _wave(c)) * _wave(c), 1e-6),
    ),
    Case(
        "below zero",
        "pupil",
        "heights all negative",
        "fractional powers, clipping",
        "the PSF of the shifted map",
        _relief(lambda h, c: h - 7 * _wave(c), 1e-6),
    ),
    Case(
        "random heights",
        "pupil",
        "each sample of its own height",
        "light beyond the window lost",
        "all light",
        _random_heights,
    ),
    Case(
        "no open cell",
        "pupil",
        "a mask that lets nothing through",
        "0 / 0 in the energy",
        "one message",
        _no_light,
    ),
    Case(
        "one sample",
        "pupil",
        "a height map of 1 x 1",
        "an axis of length 1",
        "as without a mask",
        _one_sample,
    ),
    Case(
        "windows odd and even",
        "pupil",
        "windows of 1 to 33 pixels",
        "half a pixel",
        "cut from one PSF",
        _windows,
    ),
    Case(
        "replicas",
        "pupil",
        "a pupil sampled every 300 um",
        "copies of the PSF in the window",
        "one message with both numbers",
        _replicas,
    ),
    Case("mirrored", "pupil", "a mask upside down", "an axis exchanged", "its PSF upside down", _mirrored),
    Case("both sides of focus", "pupil", "psi and -psi", "a sign", "the same PSF", _both_sides_of_focus),
    Case(
        "extreme distances",
        "pupil",
        "infinity, 1e12, 1e9 and 0.05 m",
        "1/z lost",
        "all light",
        _extreme_distances,
    ),
)
