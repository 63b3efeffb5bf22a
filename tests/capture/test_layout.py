"""Where a frame is composited, and where it is cut: chosen once for PSFs of all widths."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
import torch

from edofsim.capture import Fidelity, capture, imaging
from edofsim.capture.imaging import Axes, imaging_of, layout_within
from edofsim.capture.occlusion import OCCLUSIONS
from edofsim.capture.occlusion.hidden import Layout
from edofsim.capture.occlusion.slabs import _cheapest
from edofsim.optics import Camera
from edofsim.recipe import CameraRecipe
from edofsim.recipe.camera import PsfSettings

CAMERA = Camera.from_recipe(CameraRecipe(name="test", psf=PsfSettings(window_px=48)))


def view_with_an_edge_outside(bench):
    """A near bar beyond the frame, but within the reach of the recipe's PSFs; a far wall behind it."""
    margin, side = 24, 40 + 2 * 24
    bar = torch.zeros(side, side)
    bar[4:84, 4:14] = 1  # 10 to 20 pixels left of the frame
    depth = torch.ones(side, side)
    sheets = [(bar, depth * 2, torch.rand(3, side, side)), (depth, depth * 0.2, torch.rand(3, side, side))]
    view = bench.stacked_view(sheets, margin, CAMERA.pixel_angle)
    return view


def imaging_by(view, **fidelity):
    ends = float(view.inverse_depth.min()), float(view.inverse_depth.max())
    nodes = torch.tensor(ends, dtype=torch.float64)
    axes = Axes(torch.eye(3), view.wavelengths, torch.ones(3), ends, nodes)
    return imaging_of(CAMERA, Fidelity(**fidelity), axes)


def test_the_layout_is_that_of_the_widest_psfs(bench):
    view = view_with_an_edge_outside(bench)
    full = imaging_by(view).layout(view)
    assert full.tiles or full.whole
    for less in ({"window_px": 16}, {"margin_px": 4}):
        assert imaging_by(view, **less).layout(view) == full
    assert imaging_by(view, occlusion="none").layout(view) is None


def test_photos_are_composited_so(bench, monkeypatch):
    view = view_with_an_edge_outside(bench)
    found = []

    def noted(light, blurring, layout):
        found.append((blurring.reach, layout))
        return OCCLUSIONS["none"](light, blurring)

    monkeypatch.setitem(imaging.OCCLUSIONS, "hidden", noted)
    for window in (None, 16):
        capture(view, CAMERA, Fidelity(window_px=window))
    (wide, full), (narrow, same) = found
    assert wide > narrow and same == full and (full.tiles or full.whole)


@pytest.mark.parametrize("seed", range(20))
def test_cuts_are_the_cheapest_of_all_there_are(seed):
    """Against every choice of cuts behind eight bins."""
    draw = np.random.default_rng(seed)
    count, price = 8, 0.3
    beside = draw.random(count) + 0.01
    pairs = np.triu(draw.random((count, count)) * draw.integers(0, 2, (count, count)))

    def costs(cuts):
        left = sum(
            pairs[first, last]
            for first in range(count)
            for last in range(first, count)
            if not any(first <= cut <= last for cut in cuts)
        )
        return left + sum(beside[cut] + price for cut in cuts)

    every = (cuts for size in range(count + 1) for cuts in combinations(range(count), size))
    assert costs(_cheapest(beside, pairs, price)) == pytest.approx(min(map(costs, every)))


def test_a_layout_that_is_known_is_that_which_is_chosen(bench):
    view = view_with_an_edge_outside(bench)
    gap = imaging_by(view).blurring.gap
    layout = layout_within(view, gap, 48)
    fidelity = Fidelity(sub_apertures=3)
    chosen, given = (capture(view, CAMERA, fidelity, layout=each).clean for each in (None, layout))
    assert torch.equal(chosen, given)
    assert not torch.equal(chosen, capture(view, CAMERA, fidelity, layout=Layout(whole=[])).clean)
