"""Hard cases: a named catalogue of views, PSFs and noise that runs through any camera, against a truth."""

from __future__ import annotations

from ..optics import Camera
from . import camera_cases, white_wall
from .case import Cameras, Case, Finding
from .depth_views import COVERAGE, DEPTH
from .light_views import IMAGE, RADIANCE, SPECTRUM
from .photos import photo_cases
from .true_photos import OWN, Source
from .views import small_cameras, with_small_window

EXPECTED = {
    "depth": ("each fragment's own PSF, added up", DEPTH),
    "coverage": ("as much light as there is, finite derivatives", COVERAGE),
    "radiance": ("linear in the light", RADIANCE),
    "spectrum": ("the response-weighted sum over bands", SPECTRUM),
    "image": ("the same as in a larger frame", IMAGE),
}
"""Groups of photos: what is right, and their views."""


def photo_cases_of(cameras: Cameras, source: Source = OWN) -> tuple[Case, ...]:
    """All hard views through these cameras, whose PSF's window is `views.WINDOW`."""
    return tuple(
        case
        for group, (expected, rows) in EXPECTED.items()
        for case in photo_cases(group, expected, rows, cameras, source)
    )


def cases_of(camera: Camera | None = None) -> tuple[Case, ...]:
    """The whole catalogue: for the small cameras and the shipped ones, or for a camera of one's own."""
    small, shipped = small_cameras, white_wall.shipped_cameras
    if camera is not None:
        name, own = camera.recipe.name, with_small_window(camera)
        small, shipped = (lambda: {name: own}), (lambda: {name: camera})
    return (*photo_cases_of(small), *white_wall.cases_of(shipped), *camera_cases.cases_of(small))


__all__ = ["EXPECTED", "Case", "Finding", "cases_of", "photo_cases_of", "small_cameras"]
