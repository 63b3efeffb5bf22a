"""Plots: they survive hard data, recolour for dark pages, and their axes say what they show."""

from __future__ import annotations

import math
import re

import pytest
import torch

from edofsim.errors import InputError
from edofsim.report import ImageScore, line_plot
from edofsim.report.figures import depth_plot, score_plot, time_plot
from edofsim.report.figures_optics import height_plot, psf_plot
from edofsim.report.plot import DARK, darken, metre_ticks, spread
from edofsim.restore.scores import DepthScore, Score


def scores(*psnr: float) -> dict[str, ImageScore]:
    edges = (0.0, 0.6, 1.5, 3.0, math.inf)
    ranges = tuple(DepthScore(edges[i], edges[i + 1], Score(p, 0.9, 10)) for i, p in enumerate(psnr))
    return {"photo": ImageScore(Score(20.0, 0.8, 40), ranges)}


def test_ticks_are_round_metres_with_infinity():
    ticks = metre_ticks(0.0, 2.0)
    metres = [math.inf if t == 0 else round(1 / t, 9) for t in ticks]
    assert {math.inf, 2.0, 1.0, 0.5} <= set(metres)
    assert all(b - a >= 2.0 / 9 for a, b in zip(ticks, ticks[1:], strict=False))


@pytest.mark.parametrize(("low", "high"), [(0.719, 0.819), (0.0, 0.05), (25.3, 28.0), (0.15, 0.25)])
def test_any_range_has_a_tick_inside(low, high):
    ticks = metre_ticks(low, high)
    assert ticks and all(low <= t <= high for t in ticks)


def test_spread_keeps_both_ends():
    assert spread(31, 5)[0] == 0 and spread(31, 5)[-1] == 30 and len(set(spread(31, 5))) == 5
    assert spread(3, 5) == [0, 1, 2]


@pytest.mark.parametrize(
    "depth",
    [
        torch.full((6, 8), 1.0),  # one depth
        torch.zeros(6, 8),  # nothing but infinity
        torch.full((1, 1), 2.0),
        torch.full((4, 4), math.nan),
        torch.linspace(0, 2, 48).reshape(6, 8),
    ],
)
def test_depth_picture_of_any_scene(depth):
    plot = depth_plot(depth, focus_m=1.5)
    assert plot.svg().startswith("<?xml")
    assert "nan" not in plot.alt


def test_depth_picture_names_both_ends():
    plot = depth_plot(torch.tensor([[2.0, 0.0]]))
    assert "from 0.50\u00a0m" in plot.alt and "to ∞" in plot.alt


@pytest.mark.parametrize("psnr", [(31.0, math.inf, math.nan, 24.5), (math.nan,), (), (math.inf, math.inf)])
def test_scores_that_are_no_numbers_are_left_out(psnr):
    plot = score_plot(scores(*psnr), {"photo": "Photo"}, 1.5, 0.4)
    assert plot.svg()
    assert "nan" not in plot.alt and "inf" not in plot.alt
    assert ("24.5 dB" in plot.alt) == (24.5 in psnr)


@pytest.mark.parametrize("side", [1, 2, 5, 64, 65])
@pytest.mark.parametrize("depths", [(1.0,), (0.5, 1.0, math.inf)])
def test_psfs_of_any_size_and_number(side, depths):
    values = torch.zeros(len(depths), 3, side, side)
    values[..., side // 2, side // 2] = 0.8
    plot = psf_plot(values, depths, 6.0)
    assert plot.svg() and plot.svg(narrow=True)
    assert "least 80\u00a0% of the light" in plot.caption
    assert ("∞" in plot.alt) == (math.inf in depths)


def test_psf_picture_shows_as_much_as_holds_the_light():
    """A ring of radius 20 in a window of 101: the part shown must reach it, and not much farther."""
    y, x = torch.meshgrid(torch.arange(101) - 50, torch.arange(101) - 50, indexing="ij")
    ring = ((torch.hypot(y.float(), x.float()) - 20).abs() < 1).float()
    plot = psf_plot((ring / ring.sum()).expand(1, 3, -1, -1), (1.0,), 6.0)
    side = int(re.search(r"Central (\d+) × \1 pixels", plot.caption).group(1))
    assert 39 <= side <= 43


def test_dark_pages_of_psfs_that_are_all_zero():
    assert psf_plot(torch.zeros(2, 3, 9, 9), (1.0, 2.0), 6.0).svg()


def test_height_map_says_its_span():
    height = torch.tensor([[0.0, 1.135e-6], [math.nan, 0.5e-6]])
    plot = height_plot(height, 5e-3)
    assert plot.svg()
    assert "1.14 µm" in plot.caption or "1.13 µm" in plot.caption


def test_times_of_nothing_and_of_zero():
    assert time_plot({"render": 0.0, "expose": math.nan}).svg()
    assert time_plot({}).svg()


def test_same_plot_same_bytes():
    plot = line_plot([("a", [1, 2], [3, 4])], x="x (1)", y="y (1)", alt="a", caption="c")
    assert plot.svg() == plot.svg()


def test_dark_plots_hold_no_light_colour():
    plot = line_plot(
        [("a", [1, 2, 3], [3, math.nan, 4]), ("b", [1, 2], [1, 1])],
        x="x (1)",
        y="y (1)",
        alt="a",
        caption="c",
    )
    light = plot.svg()
    assert [colour for colour in DARK if colour in light]
    assert not [colour for colour in DARK if colour in darken(light)]


def test_plots_save_as_their_name_says(tmp_path):
    plot = line_plot([("a", [1, 10], [3, 4])], x="x (1)", y="y (1)", alt="a", caption="c", log_x=True)
    assert plot.save(tmp_path / "new" / "a.png").read_bytes().startswith(b"\x89PNG")
    assert plot.save(tmp_path / "a.svg").read_text().startswith("<?xml")
    with pytest.raises(InputError, match=r"\.png or \.svg"):
        plot.save(tmp_path / "a.gif")
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be written"):
        plot.save(tmp_path / "file" / "a.png")
