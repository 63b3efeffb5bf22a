"""The USAF-1951 chart against MIL-STD-150A."""

from __future__ import annotations

import numpy as np
import pytest

from edofsim.scene import charts


@pytest.mark.parametrize(
    ("group", "element", "frequency"), [(0, 1, 1.0), (1, 1, 2.0), (2, 3, 5.04), (-2, 6, 0.445)]
)
def test_spatial_frequencies_of_the_standard(group: int, element: int, frequency: float):
    """Values printed in the standard's table, to its three digits."""
    assert charts.line_pairs_per_mm(group, element) == pytest.approx(frequency, rel=2e-3)


def test_every_bar_is_five_times_as_long_as_wide_and_the_elements_are_all_there():
    chart = charts.usaf_chart(0, 2, border=1.0)
    widths = [
        min(b.width, b.height) for b in chart.bars if max(b.width, b.height) / min(b.width, b.height) > 2
    ]
    for group in range(4):
        for element in range(1, 7):
            count = sum(np.isclose(w, charts.bar_width(group, element), rtol=1e-9) for w in widths)
            assert count == 6, (group, element)
    ratios = [max(b.width, b.height) / min(b.width, b.height) for b in chart.bars]
    assert sum(np.isclose(r, 5) for r in ratios) == 4 * 6 * 6


def test_no_two_bars_touch_and_all_lie_inside():
    """Light between two bars would otherwise be missing: each pair is apart in x or in y."""
    chart = charts.usaf_chart(-1, 3)
    low = np.array([(b.x, b.y) for b in chart.bars])
    high = low + [(b.width, b.height) for b in chart.bars]
    apart = ((low[:, None] > high[None] + 1e-9) | (low[None] > high[:, None] + 1e-9)).any(-1)
    assert apart[~np.eye(len(low), dtype=bool)].all()
    assert low.min() > 0 and (high < [chart.width, chart.height]).all()


def test_ink_is_the_exact_area_of_the_bars_at_any_resolution():
    """Grey edges hold exactly what a bar covers of a pixel: the sum of ink is the area."""
    chart = charts.usaf_chart(0, 2)
    bare = charts.Chart(chart.width, chart.height, chart.bars, ())
    area = sum(b.width * b.height for b in chart.bars)
    for density in (3.7, 11.3):
        ink = charts.rasterise(bare, density)
        pixel = chart.width * chart.height / ink.size
        assert ink.sum() * pixel == pytest.approx(area, rel=1e-5)


def test_a_bar_inside_one_pixel_is_as_grey_as_it_is_large():
    chart = charts.Chart(4, 4, (charts.Bar(1.25, 2.5, 0.5, 0.25),), ())
    ink = charts.rasterise(chart, 1.0)
    assert ink[1, 1] == pytest.approx(0.125) and ink.sum() == pytest.approx(0.125)
