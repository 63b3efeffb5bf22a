"""The hard photos with PSFs and response written out too (`written_out`): no code of `optics` is on both
sides."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache, partial
from hashlib import sha256

from torch import Tensor

from edofsim.optics import Camera
from edofsim.optics.levin import PATTERN
from edofsim.optics.masks.coded import CodedMask
from edofsim.optics.masks.cubic import CubicMask
from edofsim.recipe.camera import CameraRecipe
from edofsim.stability import Case, photo_cases_of, small_cameras
from edofsim.stability.true_photos import Source

from .written_out import Array, Psfs, Pupil, coded, cubic, height_map, sensor_response

_pupils: dict[str, Pupil] = {}


def pupil_of(recipe: CameraRecipe, height: Tensor | None = None) -> Pupil:
    """The pupil of a recipe with the paper's lens and one of the masks of `views.MASKS`; height: the free
    map."""
    mask = recipe.mask
    named = f"{recipe.lens.model_dump_json()} {mask.model_dump_json()}"
    if height is not None:
        named += sha256(height.detach().double().numpy().tobytes()).hexdigest()
    if named not in _pupils:
        lens = recipe.lens.model_dump()
        radius = lens["aperture_radius_mm"] * 1e-3
        if height is not None:
            _pupils[named] = height_map(radius, height.detach().double().numpy(), 2 * radius / len(height))
        elif isinstance(mask, CubicMask):
            _pupils[named] = cubic(radius, mask.alpha_rad)
        elif isinstance(mask, CodedMask):
            _pupils[named] = coded(radius, PATTERN)
        else:
            _pupils[named] = Pupil(radius, spherical=lens["surface_profile"] == "spherical")
    return _pupils[named]


@lru_cache(maxsize=12)
def _integrals(pupil: Pupil, nanometres: float, window: int) -> Psfs:
    points = 3 if pupil.radius < 1e-3 else 6
    return Psfs(pupil, nanometres * 1e-9, window, points)


_known: dict[tuple[Pupil, float, int, float], Array] = {}
"""PSFs by pupil, wavelength, window and inverse depth."""


def _psfs(camera: Camera, nanometres: float, window: int, inverse_depths: Sequence[float]) -> list[Array]:
    pupil = pupil_of(camera.recipe, camera.height_map)
    new = [each for each in inverse_depths if (pupil, nanometres, window, each) not in _known]
    for each, psf in zip(new, _integrals(pupil, nanometres, window).at(new) if new else (), strict=True):
        _known[pupil, nanometres, window, each] = psf
    return [_known[pupil, nanometres, window, each] for each in inverse_depths]


WRITTEN_OUT = Source(_psfs, lambda _, nanometres: sensor_response(nanometres))

CASES: tuple[Case, ...] = photo_cases_of(small_cameras, WRITTEN_OUT)


def _two(number: int) -> dict[str, Camera]:
    cameras = small_cameras()
    masks = [name for name in cameras if name != "free"]
    return {name: cameras[name] for name in (masks[(number + 1) % len(masks)], "free")}


QUICK: dict[str, Case] = {
    case.name: photo_cases_of(partial(_two, number), WRITTEN_OUT)[number] for number, case in enumerate(CASES)
}
"""The same through two masks each: the free one, and the others in turn. The brightest lamp has the clear
one, around whose PSF it is so dark that small values count."""
