"""A view with pixels of another size."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from ..render.view import View

GAP = 0.03
"""Difference of inverse depth in 1/m that parts two surfaces, as in recipes."""


def resampled(view: View, pixel_angle: float, gap: float = GAP) -> View:
    """The view as a camera with pixels of `pixel_angle` sees it, about the same axis; same field of view.

    Each fragment is shared by the new pixels that its old pixel overlaps, by area; light and coverage are
    kept per solid angle, so a constant stays constant. What comes together in a pixel is one fragment where
    its inverse depths leave no `gap` (in 1/m); hidden surfaces that do, one behind another, cover it once,
    with the mean of their light. The frame and its margin keep their extent, to within a pixel. Pixels at
    the border that are covered in part only belong to the margin or are left out.
    """
    ratio = view.pixel_angle / pixel_angle  # new pixels in an old one
    if abs(ratio - 1) < 1e-9:
        return view
    height, width = resampled_sides(view.height, view.width, ratio)
    rows, columns = view.padded_shape
    margin = max(0, int(min((rows * ratio - height) / 2, (columns * ratio - width) / 2)))
    old_row, old_column = view.pixel // columns, view.pixel % columns
    row_index, row_share = _overlaps(rows, height + 2 * margin, ratio)
    column_index, column_share = _overlaps(columns, width + 2 * margin, ratio)
    down, across = row_index.shape[1], column_index.shape[1]
    new_row = row_index[old_row][:, :, None].expand(-1, -1, across)
    new_column = column_index[old_column][:, None, :].expand(-1, down, -1)
    share = row_share[old_row][:, :, None] * column_share[old_column][:, None, :]
    fragment, i, j = torch.nonzero(share > 1e-7, as_tuple=True)
    pixel = new_row[fragment, i, j] * (width + 2 * margin) + new_column[fragment, i, j]
    part = share[fragment, i, j].to(view.coverage)
    order = _sorted(pixel, view.hidden[fragment].long(), -view.inverse_depth[fragment])
    fragment, pixel, part = fragment[order], pixel[order], part[order]
    depth, hidden = view.inverse_depth[fragment], view.hidden[fragment]
    first = torch.ones(len(pixel), dtype=torch.bool)
    first[1:] = (pixel[1:] != pixel[:-1]) | (hidden[1:] != hidden[:-1]) | (depth[:-1] - depth[1:] > gap)
    surface = first.cumsum(0) - 1

    def together(values: Tensor) -> Tensor:
        """Sums over the fragments of each surface, [..., surface]."""
        empty = values.new_zeros(*values.shape[:-1], int(first.sum()))
        return empty.index_add(-1, surface, values)

    coverage = together(view.coverage[fragment] * part)
    times = coverage.clamp_min(1)
    mean_depth = together(depth * part) / together(part)
    pixel, hidden = pixel[first], hidden[first]
    order = _sorted(pixel, -mean_depth)

    def light(values: Tensor) -> Tensor:
        return (together(values[:, fragment] * part) / times)[:, order]

    return replace(
        view,
        height=height,
        width=width,
        margin=margin,
        pixel=pixel[order],
        coverage=(coverage / times)[order],
        inverse_depth=mean_depth[order],
        radiance=light(view.radiance),
        hidden=hidden[order],
        half_difference=None if view.half_difference is None else light(view.half_difference),
        pixel_angle=pixel_angle,
        axis=None if view.axis is None else _moved(view, ratio, height, width),
    )


def _moved(view: View, ratio: float, height: int, width: int) -> tuple[float, float]:
    """The axis of a view in pixels of which `ratio` are as wide as one of the given view."""
    y, x = view.axis_px
    return height / 2 + (y - view.height / 2) * ratio, width / 2 + (x - view.width / 2) * ratio


def _sorted(*keys: Tensor) -> Tensor:
    """What sorts by the first key, then by the next ones."""
    order = torch.arange(len(keys[0]))
    for key in reversed(keys):
        order = order[torch.argsort(key[order], stable=True)]
    return order


def resampled_sides(height: int, width: int, ratio: float) -> tuple[int, int]:
    """Height and width in pixels of which `ratio` are as wide as one of the given view."""
    return max(1, round(height * ratio)), max(1, round(width * ratio))


def _overlaps(old: int, new: int, ratio: float) -> tuple[Tensor, Tensor]:
    """For each of `old` pixels, the new pixels that it overlaps and the fraction of *their* extent it fills.

    Both lines of pixels share their centre. Returns int64 [old, k] and float64 [old, k].
    """
    k = int(ratio) + 2
    begin = (torch.arange(old, dtype=torch.float64) - old / 2) * ratio + new / 2
    end = begin + ratio
    index = begin.floor().long()[:, None] + torch.arange(k)
    filled = torch.minimum(end[:, None], index + 1.0) - torch.maximum(begin[:, None], index.double())
    filled = filled.clamp_min(0) * ((index >= 0) & (index < new))
    return index.clamp(0, new - 1), filled
