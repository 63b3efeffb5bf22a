"""Photos through lenses that vary over the field: images by the PSFs of each place, joined on the sensor."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import torch
from torch import Tensor

from ..errors import InputError
from ..optics import Camera
from ..optics.field import Frame, Place, joined, relative_light, step_for
from ..render.view import View
from .crop import crop
from .fidelity import Fidelity
from .imaging import Axes, Imaging
from .occlusion.hidden import Layout

Make = Callable[[Camera], Imaging | None]


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
    camera: Camera,
    lights: Sequence[View],
    layouts: Sequence[Layout | None],
    frame: Frame,
    step: int,
    make: Make,
    glare: Callable[[View, Imaging], Tensor] | None,
) -> Tensor:
    """Unexposed images of views, [view, channel, y, x], each place of the frame by the PSFs of its place in
    the field, and as bright as these are.

    lights: as `Imaging.light` gives them; make: the optics of a camera, those of `image` where there is
    glare, those of sub-apertures where there is none; glare: [channel], of a view.
    """

    def at(place: Place) -> Tensor:
        here = camera.seen_at(place.field)
        imaging = make(here)
        assert imaging is not None
        top, left = place.rows.start, place.columns.start
        size = place.rows.stop - top, place.columns.stop - left
        images = []
        for light, layout in zip(lights, layouts, strict=True):
            part = crop(light, top, left, *size, imaging.window // 2)
            if glare is None:
                images.append(imaging.change_by_sub_apertures(part, layout))
            else:
                images.append(imaging.image(part, layout) + glare(light, imaging)[:, None, None])
        return torch.stack(images) * relative_light(here)

    return joined(frame, step, at).to(lights[0].radiance)
