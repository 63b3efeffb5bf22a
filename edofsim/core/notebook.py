"""How things show themselves in a notebook: a picture or a table, as PNG and as HTML."""

from __future__ import annotations

import base64
import json
from collections.abc import Iterable, Sequence
from html import escape
from typing import TYPE_CHECKING

import numpy as np

from ..errors import InputError
from .images import developed, png_bytes, srgb_encode

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from torch import Tensor

COLOURS = "edofsim colours"
"""Text of a PNG file: the matrix that its colours were made with."""
SHOWN_PX = (320, 640)
"""Least and greatest width of a picture in a notebook; the browser scales it."""


def srgb_pixels(image: Tensor, colours: Tensor | None = None) -> np.ndarray:
    """A linear image [3 or 1, y, x] as uint8 [y, x, 3]; full scale 1 is white, NaN is black.

    image: [3 or 1, y, x], linear.
    colours: matrix [3, 3] to linear sRGB, see `developed`; None for the image's own colours.

    Raises InputError for another shape.
    """
    if image.ndim != 3 or image.shape[0] not in (1, 3):
        raise InputError(f"an image to look at has the shape [3, y, x] or [1, y, x], not {list(image.shape)}")
    encoded = srgb_encode(developed(image.detach().cpu().float().nan_to_num(), colours))
    pixels = (encoded * 255).round().byte().permute(1, 2, 0).numpy()
    return np.ascontiguousarray(np.broadcast_to(pixels, (*pixels.shape[:2], 3)))


def picture_png(image: Tensor, colours: Tensor | None = None) -> bytes:
    """A linear image [3 or 1, y, x] as an sRGB PNG, which states the colours that `srgb_pixels` takes.

    image: [3 or 1, y, x], linear.
    colours: [3, 3] to linear sRGB; None for the image's own colours.
    """
    texts = {} if colours is None else {COLOURS: json.dumps(colours.tolist())}
    return png_bytes(srgb_pixels(image, colours), texts)


def show(image: Tensor, title: str = "", axes: Axes | None = None, colours: Tensor | None = None) -> Axes:
    """Draw an image with Matplotlib.

    image: linear, [3 or 1, y, x], full scale 1 is white.
    title: above it.
    axes: to draw in; None for new ones.
    colours: matrix [3, 3] from the sensor's colours to linear sRGB; None leaves them as they are.

    Returns the axes. Raises InputError for another shape.
    """
    from matplotlib import pyplot

    pixels = srgb_pixels(image, colours)
    if axes is None:
        _, axes = pyplot.subplots(layout="constrained")
    axes.imshow(pixels)
    axes.set_title(title)
    axes.set_axis_off()
    return axes


def picture_html(image: Tensor, caption: str, colours: Tensor | None = None) -> str:
    """A linear image with a line below it.

    image: [3 or 1, y, x], linear.
    colours: [3, 3], see `srgb_pixels`.
    """
    data = base64.b64encode(picture_png(image, colours)).decode("ascii")
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
