"""Photos through lenses that vary over the field: images by the PSFs of each place, joined on the sensor."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from torch import Tensor

from ..errors import InputError
from ..optics import Camera
from ..optics.field import Frame, Place, joined, relative_light, step_for
from ..render.view import View
from .crop import crop
from .fidelity import Fidelity
from .imaging import Axes

Part = Callable[[View, int], View]
"""Of light that fills a frame, what reaches a place from within this many pixels around it."""


def frame_of(views: Sequence[View]) -> Frame:
    """Where views look. Raises InputError where they look elsewhere than each other."""
    first = views[0]
    for view in views[1:]:
        if view.axis_px != first.axis_px:
            raise InputError(
                f"views with the optical axis at {first.axis_px} and {view.axis_px} cannot share a batch"
                " through a lens that varies over the field: photograph them one by one"
            )
    return Frame(first.height, first.width, first.axis_px, first.pixel_angle)


def field_step(camera: Camera, fidelity: Fidelity, frame: Frame, axes: Axes) -> int | None:
    """Pixels between the places that PSFs are computed at; None for one place: where a lens does not vary, or
    no more are asked for."""
    if not camera.lens.varies or fidelity.field_step_px == 0:
        return None
    if fidelity.field_step_px is not None:
        return fidelity.field_step_px
    return step_for(camera, frame, axes.wavelengths, axes.ends, fidelity.layers_db)


def image_over_field(
    camera: Camera, frame: Frame | None, step: int | None, image: Callable[[Camera, Part], Tensor]
) -> Tensor:
    """An unexposed image [..., y, x] of a frame, each place of it by the PSFs of its place in the field, and
    as bright as these are.

    step: pixels between places; None for one place, where the part is the whole.
    image: of the part of the frame that a camera sees from its place, [..., y, x].
    """
    if frame is None or step is None:
        return image(camera, lambda light, reach: light)

    def at(place: Place) -> Tensor:
        here = camera.seen_at(place.field)
        top, left = place.rows.start, place.columns.start
        size = place.rows.stop - top, place.columns.stop - left
        seen = image(here, lambda light, reach: crop(light, top, left, *size, reach))
        return seen * relative_light(here)

    return joined(frame, step, at)
