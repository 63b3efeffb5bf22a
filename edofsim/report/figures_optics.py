"""The figures of a camera: point spread functions, modulation transfer, height map."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import TYPE_CHECKING

import torch
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from torch import Tensor

from .plot import (
    DEPTH_MAP,
    HALF_IN,
    LIGHT_MAP,
    NARROW_IN,
    TITLE_PT,
    WIDE_IN,
    Plot,
    new_figure,
    spread,
)  # fmt: skip
from .words import distance, percent, significant

if TYPE_CHECKING:
    from matplotlib.axes import Axes

CHANNELS = ("Red", "Green", "Blue")
PSF_DECADES = 4  # of brightness that a picture of a PSF spans
PSF_ENERGY = 0.97  # of the light in the window that the part shown must hold, at every depth


def _draw_bar(axes: Axes, x: float, y: float, pixels: int, pixel: float) -> None:
    """As long as some pixels are in a picture."""
    axes.plot([x, x + pixels * pixel], [y, y], color="white", linewidth=2.4, solid_capstyle="butt")
    axes.text(x, y + 0.04, f"{pixels} px", color="white", fontsize=8)


def _draw_scale(figure: Figure, norm: LogNorm, place: Sequence[float]) -> None:
    """What the colours of PSFs stand for, along the longer side of `place` (left, bottom, width, height in
    inches)."""
    across, up = figure.get_size_inches()
    left, bottom, width, height = place
    scale = figure.colorbar(
        ScalarMappable(norm, LIGHT_MAP),
        cax=figure.add_axes((left / across, bottom / up, width / across, height / up)),
        orientation="horizontal" if width > height else "vertical",
    )
    scale.outline.set_visible(False)
    scale.set_label("fraction of the light in a pixel")


def psf_plot(psfs: Tensor, depths_m: Sequence[float], pixel_um: float) -> Plot:
    """Point spread functions as small multiples: channels by depths, logarithmic brightness, scale bar.

    psfs: [depth, channel, y, x].
    """
    values = psfs.detach().cpu().double()
    order = sorted(range(len(depths_m)), key=lambda i: depths_m[i])
    side = _part_with_energy(values, PSF_ENERGY)
    top, left = (n // 2 - side // 2 for n in values.shape[-2:])
    shown = torch.nan_to_num(values[..., max(top, 0) : top + side, max(left, 0) : left + side], nan=0.0)
    peak = float(shown.max()) or 1.0
    tiles = shown.clamp_min(peak * 1e-9).numpy()  # a logarithm cannot show zero
    bar = next((n for n in (100, 50, 20, 10, 5, 2) if n <= 0.42 * side), 1)

    def paint(narrow: bool = False) -> Figure:
        picked = [order[i] for i in spread(len(order), 5 if narrow else 7)]
        down, across = (len(picked), 3) if narrow else (3, len(picked))
        left, top, gap = 0.3, 0.28, 0.06
        right, bottom = (0.1, 0.85) if narrow else (0.95, 0.05)
        room = (NARROW_IN if narrow else WIDE_IN) - left - right - gap * (across - 1)
        tile = min(room / across, 1.9)
        width = left + right + across * tile + (across - 1) * gap
        height = top + bottom + down * tile + (down - 1) * gap
        figure = new_figure(width, height, layout="none")
        axes = figure.add_axes((0, 0, 1, 1))  # one set for all: sets take longer to draw than pictures
        norm = LogNorm(peak * 10.0**-PSF_DECADES, peak, clip=True)
        words = {"size": TITLE_PT, "weight": "bold"}
        for row in range(down):
            for column in range(across):
                x, y = left + column * (tile + gap), height - top - tile - row * (tile + gap)
                depth, channel = (row, column) if narrow else (column, row)
                tile_values = tiles[picked[depth], channel]
                axes.imshow(tile_values, cmap=LIGHT_MAP, norm=norm, extent=(x, x + tile, y, y + tile))
                at = distance(depths_m[picked[depth]])
                if row == 0:
                    said = CHANNELS[channel] if narrow else at
                    axes.text(x + tile / 2, y + tile + 0.08, said, ha="center", va="bottom", **words)
                if column == 0:
                    said = at if narrow else CHANNELS[channel]
                    axes.text(x - 0.05, y + tile / 2, said, ha="right", va="center", rotation=90, **words)
                if row == column == 0:
                    _draw_bar(axes, x + 0.07 * tile, y + 0.09 * tile, bar, tile / shown.shape[-1])
        axes.set(xlim=(0, width), ylim=(0, height))
        axes.set_axis_off()
        upright = (width - 0.8, 0.05, 0.12, height - top - bottom)
        _draw_scale(figure, norm, (left, 0.52, width - left - right, 0.12) if narrow else upright)
        return figure

    kept = percent(float(shown.sum((-2, -1)).min()))
    names = ", ".join(distance(depths_m[i]) for i in order)
    return Plot(
        paint,
        alt=f"Point spread functions of the red, green and blue channel at {names}; the largest value is "
        f"{percent(peak)} of the light in one pixel.",
        caption=f"Point spread functions by depth, upright as in the picture, logarithmic over {PSF_DECADES} "
        f"decades, one scale for all. Central {shown.shape[-1]} × {shown.shape[-2]} pixels, which hold at "
        f"least {kept} of the light; the bar is {bar} {'pixel' if bar == 1 else 'pixels'} = "
        f"{significant(bar * pixel_um)} µm on the sensor.",
        paint_narrow=functools.partial(paint, True),
    )


def height_plot(height_m: Tensor, width_m: float) -> Plot:
    """Height map [y, x] of a mask in metres, seen from the sensor; width_m is what its columns cover.

    height_m: [y, x], metres.
    """
    height = height_m.detach().cpu().double() * 1e6
    finite = height[torch.isfinite(height)]
    tallest = significant(float(finite.max() - finite.min()) if finite.numel() else 0.0)
    right = 1e3 * width_m / 2
    top = right * height.shape[0] / height.shape[1]

    def paint() -> Figure:
        figure = new_figure(HALF_IN, 3.6)
        axes = figure.add_subplot()
        shown = axes.imshow(height.numpy(), cmap=DEPTH_MAP, extent=(-right, right, -top, top))
        axes.grid(False)
        axes.set_xlabel("across the pupil (mm)")
        axes.set_ylabel("up the pupil (mm)")
        bar = figure.colorbar(shown, ax=axes, aspect=26)
        bar.outline.set_visible(False)
        bar.set_label("height (µm)")
        return figure

    return Plot(
        paint,
        alt=f"Height map of the mask, {tallest} µm from the lowest to the highest point.",
        caption=f"Height of the mask at the pupil, seen from the sensor; {tallest} µm between its extremes.",
    )


def _part_with_energy(values: Tensor, energy: float) -> int:
    """Side of the smallest centred square that holds this part of every PSF's light in the window."""
    light = torch.nan_to_num(values, nan=0.0)
    rows, columns = light.shape[-2:]
    total = light.sum((-2, -1))
    for side in range(min(15, rows, columns), min(rows, columns) + 1, 2):
        top, left = rows // 2 - side // 2, columns // 2 - side // 2
        held = light[..., max(top, 0) : top + side, max(left, 0) : left + side].sum((-2, -1))
        if bool((held >= energy * total).all()):
            return side
    return min(rows, columns)
