"""Photos through lenses that vary over the field: light blurred by the PSFs of where it comes from, or images
by the PSFs of each place, joined on the sensor."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import torch
from torch import Tensor

from ..core.progress import Progress
from ..core.store import user_folder
from ..errors import InputError
from ..optics import Camera
from ..optics.contrast import CONTRAST_DB
from ..optics.field import Frame, Place, errors_by_step, joined, relative_light, step_for
from ..optics.psf import carries_gradients
from ..optics.terms import HALF, terms_of
from ..render.view import View
from .crop import crop
from .fidelity import Fidelity, simpler_camera
from .imaging import Axes, Imaging
from .terms import TermBlurring

NEARER_DB = 6.0
"""Than depth nodes: kernels make up the PSFs of these."""
CHANGE_STEP_PX = 128
"""Least pixels between places in the field that have sub-apertures of their own: what these change is little,
and varies little."""
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


def change_over_field(
    camera: Camera,
    fidelity: Fidelity,
    frame: Frame | None,
    step: int | None,
    axes: Axes,
    exposure: float,
    changed: Callable[[Camera, Part], Tensor],
) -> Tensor:
    """What `changed` says that a way to simulate changes in an unexposed photo, as `image_over_field`.

    Where the change is so little that the axis's, in the light of each place, errs by no more than half of
    the mean square of `layers_db`, that is taken; else that of as few places as may be, `CHANGE_STEP_PX`
    apart at least.
    exposure: factor from radiance to full scale.
    """
    change = changed(camera, lambda light, reach: light)
    if frame is None or step is None:
        return change
    least = max(step, CHANGE_STEP_PX)
    size = exposure * float(change.detach().square().mean().sqrt())
    # as large a part of the change errs as of a picture's contrast
    allowed = HALF**0.5 * 10 ** ((-fidelity.layers_db - CONTRAST_DB) / 20) / max(size, 1e-30)

    def light(at: Place) -> Tensor:
        return torch.full_like(at.share, relative_light(camera.seen_at(at.field)))

    for apart, error in errors_by_step(camera, frame, axes.wavelengths, axes.ends, lit=True):
        # in proportion to the distance from the axis: over a frame, a third of the corner's mean square
        if apart == 0 and error < allowed * math.sqrt(3):
            return change * joined(frame, least, light)
        if apart and (error < allowed or apart <= least):
            least = apart
            break
    return image_over_field(camera, frame, least, changed)


def image_over_field(
    camera: Camera, frame: Frame | None, step: int | None, image: Callable[[Camera, Part], Tensor]
) -> Tensor:
    """An unexposed image [..., y, x] of a frame, each place by, and as bright as, the PSFs from there.

    step: pixels between places; None for one place, where the part is the whole.
    image: of the part of the frame that a camera sees from its place, [..., y, x].
    camera: that looks along the axis.
    frame: rows and columns of the image; None where the lens does not vary.
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


def in_terms(camera: Camera, fidelity: Fidelity, device: torch.device | str) -> bool:
    """Whether PSFs of places are taken as sums of a few kernels: not where gradients must reach a mask."""
    plain = fidelity.occlusion in ("none", "hidden") and torch.device(device).type == "cpu"
    return fidelity.field_terms and plain and not carries_gradients(camera)


def over_field(
    imaging: Imaging,
    camera: Camera,
    axes: Axes,
    frame: Frame,
    step: int,
    *,
    cache: Path | None,
    progress: Progress,
) -> Imaging:
    """Optics of the axis as those of the whole field. step: pixels between places where straight lines
    between PSFs are true enough; cache: a folder for what they come from, None for the user's."""
    fidelity, gathering, axial = imaging.fidelity, imaging.gathering, imaging.blurring
    terms = terms_of(
        simpler_camera(camera, fidelity),
        frame,
        step,
        gathering.wavelengths,
        axes.nodes,
        gathering.psfs if fidelity.band_groups else None,
        window_px=imaging.window,
        db=fidelity.layers_db + NEARER_DB,
        cache=user_folder() / "terms" if cache is None else cache,
        dtype=axial.response.dtype,
        progress=progress,
    )
    own = (axial.psfs, axial.response, axial.gap, axial.between)
    return replace(imaging, blurring=TermBlurring(*own, terms, step, fidelity.layers_db))
