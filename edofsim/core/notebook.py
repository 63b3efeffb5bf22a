"""How things show themselves in a notebook: a picture or a table, as PNG and as HTML."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Sequence
from html import escape
from typing import TYPE_CHECKING

import numpy as np

from ..errors import InputError
from .images import png_bytes, srgb_encode

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from torch import Tensor

SHOWN_PX = (320, 640)
"""Least and greatest width of a picture in a notebook; the browser scales it."""


def srgb_pixels(image: Tensor) -> np.ndarray:
    """A linear image [3 or 1, y, x] as uint8 [y, x, 3]; full scale 1 is white, NaN is black.

    Raises InputError for another shape.
    """
    if image.ndim != 3 or image.shape[0] not in (1, 3):
        raise InputError(f"an image to look at has the shape [3, y, x] or [1, y, x], not {list(image.shape)}")
    encoded = srgb_encode(image.detach().cpu().float().nan_to_num())
    pixels = (encoded * 255).round().byte().permute(1, 2, 0).numpy()
    return np.ascontiguousarray(np.broadcast_to(pixels, (*pixels.shape[:2], 3)))


def picture_png(image: Tensor) -> bytes:
    """A linear image [3 or 1, y, x] as an sRGB PNG."""
    return png_bytes(srgb_pixels(image))


def show(image: Tensor, title: str = "", axes: Axes | None = None) -> Axes:
    """Draw a linear image [3 or 1, y, x] with Matplotlib, full scale 1 white. Returns the axes, new ones
    unless they are given. Raises InputError for another shape."""
    from matplotlib import pyplot

    pixels = srgb_pixels(image)
    if axes is None:
        _, axes = pyplot.subplots(layout="constrained")
    axes.imshow(pixels)
    axes.set_title(title)
    axes.set_axis_off()
    return axes


def picture_html(image: Tensor, caption: str) -> str:
    """A linear image with a line below it."""
    data = base64.b64encode(picture_png(image)).decode("ascii")
    width = min(max(SHOWN_PX[0], image.shape[-1]), SHOWN_PX[1])
    return (
        f'<figure style="margin:0"><img alt="{escape(caption)}" src="data:image/png;base64,{data}" '
        f'style="max-width:100%;width:{width}px"><figcaption>{escape(caption)}</figcaption></figure>'
    )


def table_html(caption: str, heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table with a line above it; heads may be empty."""
    top = "".join(f'<th style="text-align:left">{escape(head)}</th>' for head in heads)
    body = "".join(
        "<tr>" + "".join(f'<td style="text-align:left">{escape(cell)}</td>' for cell in row) + "</tr>"
        for row in rows
    )
    head = f"<thead><tr>{top}</tr></thead>" if heads else ""
    return f"<table><caption>{escape(caption)}</caption>{head}<tbody>{body}</tbody></table>"
