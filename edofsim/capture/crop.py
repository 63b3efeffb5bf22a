"""Cutting a view to a part of its frame, and widening its margin."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from ..render.view import View


def crop(view: View, top: int, left: int, height: int, width: int, margin: int) -> View:
    """A part of the frame as a view of its own: rows top to top + height, columns left to left + width.

    Counted in the frame without its margin; the optical axis stays where it is in the scene. Where the new
    margin reaches beyond the view, the view's outermost pixels are repeated: light from there is unknown, and
    darkness would be a worse guess.
    """
    rows, columns = view.padded_shape
    wanted_rows = torch.arange(top - margin, top + height + margin) + view.margin
    wanted_columns = torch.arange(left - margin, left + width + margin) + view.margin
    new_rows, new_columns = height + 2 * margin, width + 2 * margin
    source = (
        wanted_rows.clamp(0, rows - 1)[:, None] * columns + wanted_columns.clamp(0, columns - 1)[None, :]
    ).reshape(-1)
    part = _take(view, source.to(view.pixel.device), height, width, margin, new_rows * new_columns)
    if (top, left, height, width) == (0, 0, view.height, view.width):
        return part
    y, x = view.axis_px
    return replace(part, axis=(y - top, x - left))


def with_margin(view: View, margin: int) -> View:
    """The view with a margin of at least that many pixels; its outermost pixels are repeated into it."""
    if view.margin >= margin:
        return view
    return crop(view, 0, 0, view.height, view.width, margin)


def _take(view: View, source: Tensor, height: int, width: int, margin: int, pixels: int) -> View:
    """A view whose pixel i shows pixel source[i] of the given one."""
    if view.one_each:
        which, pixel = source, torch.arange(pixels, device=source.device)
    else:
        rows, columns = view.padded_shape
        counts = torch.bincount(view.pixel, minlength=rows * columns)
        starts = torch.cumsum(counts, 0) - counts
        copies = counts[source]
        pixel = torch.repeat_interleave(torch.arange(pixels, device=source.device), copies)
        first = torch.cumsum(copies, 0) - copies
        which = starts[source][pixel] + torch.arange(pixel.numel(), device=source.device) - first[pixel]
    return replace(
        view,
        height=height,
        width=width,
        margin=margin,
        pixel=pixel,
        coverage=view.coverage[which],
        inverse_depth=view.inverse_depth[which],
        radiance=view.radiance.index_select(1, which),
        hidden=view.hidden[which],
        half_difference=None if view.half_difference is None else view.half_difference.index_select(1, which),
    )
