"""Where a blur crosses a depth edge: the pixels in which ways to simulate occlusion differ."""

from __future__ import annotations

import torch
from scipy.ndimage import distance_transform_edt
from torch import Tensor

from ..optics import Camera
from ..render.view import View
from .prepare import blur_per_dioptre


def near_edges(view: View, camera: Camera) -> Tensor:
    """Pixels of the frame within the blur radius of a depth edge, bool [y, x].

    An edge is where two surfaces meet, in a pixel or in neighbours, whose blurs differ by a pixel or more.
    Its blur radius is the geometric one, of the lens without a mask, of that surface of the two which is
    farther out of focus; at least a pixel.
    """
    radius = _blur_radius_at_edges(view, camera).ceil()
    found = torch.zeros_like(radius, dtype=torch.bool)
    for size in torch.unique(radius[radius > 0]).tolist():
        found |= torch.from_numpy(distance_transform_edt((radius != size).numpy()) <= size)
    return view.crop_margin(found)


def edge_distance(view: View, camera: Camera) -> Tensor:
    """How far each pixel of the frame is from the nearest depth edge (see `near_edges`), float32 [y, x] in
    pixels, 0 on both sides of it; infinity in a view without any."""
    on = _blur_radius_at_edges(view, camera) > 0
    if not on.any():
        return view.crop_margin(torch.full(on.shape, torch.inf))
    return view.crop_margin(torch.from_numpy(distance_transform_edt(~on.numpy())).float())


def _blur_radius_at_edges(view: View, camera: Camera) -> Tensor:
    """Of what is farther out of focus at a depth edge, at least a pixel, on both sides of it; 0 elsewhere.
    Padded frame, [y, x] in pixels."""
    per_dioptre = blur_per_dioptre(camera)
    near, far = _nearest_and_farthest(view)
    focus = 1 / camera.recipe.focus.distance_m
    radius = torch.zeros_like(near)
    for a, b in (
        ((slice(None), slice(None)), (slice(None), slice(None))),
        ((slice(None, -1), slice(None)), (slice(1, None), slice(None))),
        ((slice(None), slice(None, -1)), (slice(None), slice(1, None))),
    ):
        front, behind = torch.maximum(near[a], near[b]), torch.minimum(far[a], far[b])
        wide = torch.maximum((front - focus).abs(), (behind - focus).abs()) * per_dioptre / 2
        wide = torch.where(front - behind > 1 / per_dioptre, wide.clamp_min(1.0), torch.zeros_like(wide))
        for part in (a, b):
            radius[part] = torch.maximum(radius[part], wide)
    return radius


def _nearest_and_farthest(view: View) -> tuple[Tensor, Tensor]:
    """Largest and smallest inverse depth that each pixel of the padded frame sees, [y, x] in 1/m."""
    rows, columns = view.padded_shape
    which = ~view.hidden & (view.coverage > 0)
    pixel, depth = view.pixel[which].cpu(), view.inverse_depth[which].double().cpu()
    empty = torch.zeros(rows * columns, dtype=torch.float64)
    near = empty.scatter_reduce(0, pixel, depth, "amax", include_self=False)
    far = empty.scatter_reduce(0, pixel, depth, "amin", include_self=False)
    return near.reshape(rows, columns), far.reshape(rows, columns)
