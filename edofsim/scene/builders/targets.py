"""Test targets: the USAF-1951 chart and the ColorChecker."""

from __future__ import annotations

from ...recipe.things import ColorChecker, UsafChart
from .. import charts, solids
from ..model import BandTexture
from ..spectra import color_checker as measured_patches
from ..spectra import reflectance
from ..surfaces import matt
from ..textures import flat, mixture
from .context import Context, Part

MM = 1e-3
MAX_TEXTURE_PX = 4096


def usaf_chart(recipe: UsafChart, context: Context) -> list[Part]:
    """The chart as one textured panel, `pixels_per_bar` texture pixels across its finest bar (at most 4096
    across the chart)."""
    chart = charts.usaf_chart(recipe.first_group, recipe.pairs, recipe.border_mm)
    finest = charts.bar_width(recipe.first_group + 2 * recipe.pairs - 1, 6)
    density = min(recipe.pixels_per_bar / finest, MAX_TEXTURE_PX / max(chart.width, chart.height))
    ink = charts.rasterise(chart, density)
    white, black = (reflectance(r, context.wavelengths) for r in (recipe.white, recipe.black))
    shape = solids.panel(chart.width * MM, chart.height * MM)
    return [Part("", shape, matt(mixture(ink, white, black)))]


def color_checker(recipe: ColorChecker, context: Context) -> list[Part]:
    """A card of 6 x 4 patches, each a panel of its own with its measured spectrum.

    Proportions of the chart of 280 x 190 mm: patches of 40 mm, 3.5 mm apart."""
    width = recipe.width_mm * MM
    height = width * 190 / 280
    pitch, patch = width * 43.5 / 280, width * 40 / 280
    parts = [Part("", solids.panel(width, height), matt(flat(recipe.card, context.wavelengths)))]
    lift = 2e-4 * width  # the patches lie just above the card
    for index, (name, spectrum) in enumerate(measured_patches(context.wavelengths).items()):
        row, column = divmod(index, 6)
        centre = ((column - 2.5) * pitch, (1.5 - row) * pitch, -lift)
        surface = matt(BandTexture(spectrum[None].astype("float32")))
        parts.append(Part(name, solids.panel(patch, patch, centre), surface))
    return parts
