"""Test targets: the USAF-1951 chart and the ColorChecker."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from ...recipe.base import NotNegative, Positive
from ...recipe.placed import Placed
from ...recipe.surfaces import Reflectance
from .. import charts, solids
from ..model import BandTexture
from ..spectra import color_checker as measured_patches
from ..spectra import reflectance
from ..surfaces import matt
from ..textures import flat, mixture
from .context import Builder, Context, Part

MM = 1e-3
MAX_TEXTURE_PX = 4096


class UsafChart(Builder, Placed):
    """A USAF-1951 resolution chart (MIL-STD-150A), as large as its groups make it.

    `first_group` is the coarser group of the outermost pair; `pairs` nested pairs of groups are drawn."""

    kind: Literal["usaf_chart"]
    first_group: Annotated[int, Field(ge=-8, le=8)] = 0
    """coarser group of the outermost pair"""
    pairs: Annotated[int, Field(ge=1, le=3)] = 2
    """nested pairs of groups"""
    border_mm: NotNegative | None = None
    """white border around the pattern; None: four bars of the largest element"""
    white: Reflectance = 0.85
    """reflectance of the white"""
    black: Reflectance = 0.03
    """reflectance of the bars"""
    pixels_per_bar: Annotated[int, Field(ge=2, le=32)] = 4
    """texture pixels across the finest bar of the chart"""
    anchor: Literal["centre", "base"] = "centre"
    """what `x`, `y` place: its centre, or the middle of its base"""

    def build(self, context: Context) -> list[Part]:
        """The chart as one textured panel, `pixels_per_bar` texture pixels across its finest bar, at most
        4096 across the chart."""
        chart = charts.usaf_chart(self.first_group, self.pairs, self.border_mm)
        finest = charts.bar_width(self.first_group + 2 * self.pairs - 1, 6)
        density = min(self.pixels_per_bar / finest, MAX_TEXTURE_PX / max(chart.width, chart.height))
        ink = charts.rasterise(chart, density)
        white, black = (reflectance(r, context.wavelengths) for r in (self.white, self.black))
        shape = solids.panel(chart.width * MM, chart.height * MM)
        return [Part("", shape, matt(mixture(ink, white, black)))]


class ColorChecker(Builder, Placed):
    """The 24 patches with their measured spectra, on a black card."""

    kind: Literal["color_checker"]
    width_mm: Positive = 280.0
    """width of the card, mm"""
    card: Reflectance = 0.03
    """reflectance of the card"""
    anchor: Literal["centre", "base"] = "centre"
    """what `x`, `y` place: its centre, or the middle of its base"""

    def build(self, context: Context) -> list[Part]:
        """A card of 6 x 4 patches, each a panel of its own with its measured spectrum.

        Proportions of the chart of 280 x 190 mm: patches of 40 mm, 3.5 mm apart."""
        width = self.width_mm * MM
        height = width * 190 / 280
        pitch, patch = width * 43.5 / 280, width * 40 / 280
        parts = [Part("", solids.panel(width, height), matt(flat(self.card, context.wavelengths)))]
        lift = 2e-4 * width  # the patches lie just above the card
        for index, (name, spectrum) in enumerate(measured_patches(context.wavelengths).items()):
            row, column = divmod(index, 6)
            centre = ((column - 2.5) * pitch, (1.5 - row) * pitch, -lift)
            surface = matt(BandTexture(spectrum[None].astype("float32")))
            parts.append(Part(name, solids.panel(patch, patch, centre), surface))
        return parts
