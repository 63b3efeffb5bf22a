"""Enlarged parts: textured squares at the depths that were asked for, wherever the picture has them."""

from __future__ import annotations

import math

import pytest
import torch

from edofsim.report import DepthRange, choose_crops
from edofsim.report.crops import near_focus_far


def checks(ideal: torch.Tensor, y: int, x: int, side: int) -> None:
    """A patch of single-pixel checks, the strongest texture there is."""
    yy, xx = torch.meshgrid(torch.arange(side), torch.arange(side), indexing="ij")
    ideal[:, y : y + side, x : x + side] = ((yy + xx) % 2).float()


@pytest.fixture
def scene() -> tuple[torch.Tensor, torch.Tensor]:
    """Left half at 0.5 m, right half at 4 m, 96 x 128; a patch of checks in each, grey elsewhere."""
    depth = torch.full((96, 128), 2.0)
    depth[:, 64:] = 0.25
    ideal = torch.full((3, 96, 128), 0.4)
    checks(ideal, 8, 12, 20)
    checks(ideal, 60, 90, 20)
    return depth, ideal


def test_each_range_gets_the_square_that_holds_its_texture(scene):
    depth, ideal = scene
    near, far = choose_crops(depth, ideal, 20, [DepthRange(0.4, 0.6), DepthRange(3, math.inf)])
    # a square one pixel off still holds the seams between checks and grey, so that pixel is free
    assert abs(near.x - 12) <= 1 and abs(near.y - 8) <= 1
    assert abs(far.x - 90) <= 1 and abs(far.y - 60) <= 1
    assert near.depth_m == pytest.approx(0.5) and far.depth_m == pytest.approx(4.0)
    assert near.cut(ideal).shape == (3, 20, 20)


def test_texture_of_another_depth_does_not_count(scene):
    depth, ideal = scene
    checks(ideal, 30, 80, 40)  # far, and more of it than near
    (near,) = choose_crops(depth, ideal, 20, [DepthRange(0.4, 0.6)])
    assert near.x + near.size <= 64 + 0.4 * 20  # at least 60 % of the square is near


def test_two_ranges_that_overlap_get_two_parts(scene):
    depth, ideal = scene
    first, second = choose_crops(depth, ideal, 20, [DepthRange(0.4, 0.6), DepthRange(0.3, 0.8)])
    overlap = max(0, 20 - abs(first.x - second.x)) * max(0, 20 - abs(first.y - second.y))
    assert overlap <= 0.25 * 20 * 20


def test_infinity_is_a_depth():
    depth = torch.zeros(32, 32)
    (crop,) = choose_crops(depth, torch.rand(3, 32, 32, generator=torch.Generator().manual_seed(1)), 8,
                           [DepthRange(3, math.inf)])  # fmt: skip
    assert math.isinf(crop.depth_m)


def test_a_range_without_pixels_gets_no_square(scene):
    assert choose_crops(*scene, 20, [DepthRange(1.0, 1.2)]) == ()


def test_without_texture_the_middle_is_shown():
    (crop,) = choose_crops(torch.ones(40, 60), torch.full((3, 40, 60), 0.5), 10, [DepthRange(0.9, 1.1)])
    assert (crop.x, crop.y) == (25, 15)


@pytest.mark.parametrize("shape", [(1, 1), (1, 7), (5, 3)])
def test_pictures_smaller_than_a_square(shape):
    (crop,) = choose_crops(torch.ones(shape), torch.rand(3, *shape), 64, [DepthRange(0.5, 2)])
    assert crop.size == min(shape)
    assert crop.cut(torch.ones(shape)).shape == (crop.size, crop.size)


def test_thin_things_are_found_although_no_square_is_full_of_them():
    depth = torch.full((64, 64), 0.25)
    depth[:, 20:22] = 2.0  # a wire, 2 pixels wide
    ideal = torch.full((3, 64, 64), 0.5)
    ideal[:, 30:34, 20:22] = 1.0  # with one bright mark
    (crop,) = choose_crops(depth, ideal, 16, [DepthRange(0.4, 0.6)])
    assert crop.x <= 20 and crop.x + 16 >= 22
    assert crop.y <= 30 and crop.y + 16 >= 34


def test_nearest_focus_and_farthest(scene):
    depth, _ = scene
    depth[:, 56:72] = 1 / 1.5
    ranges = [DepthRange(0, 0.6), DepthRange(0.6, 1.2), DepthRange(1.2, 2), DepthRange(2, math.inf)]
    near, focus, far = near_focus_far(depth, ranges, 1.5)
    assert (near.name, focus.name, far.name) == ("Nearest", "At focus", "Farthest")
    assert near.far_m == 0.6 and far.near_m == 2
    assert focus.near_m < 1.5 < focus.far_m


def test_focus_where_nothing_is_sharp_is_called_so():
    depth = torch.full((10, 30), 2.0)
    depth[:, 10:] = 1.2
    depth[:, 20:] = 0.1
    ranges = [DepthRange(0, 0.6), DepthRange(0.6, 1.2), DepthRange(2, math.inf)]
    names = [r.name for r in near_focus_far(depth, ranges, 1.5)]
    assert names == ["Nearest", "Nearest to focus", "Farthest"]


def test_one_depth_is_shown_once():
    depth = torch.full((20, 20), 1.0)
    assert [r.name for r in near_focus_far(depth, [DepthRange(0.85, 1.15)], 1.0)] == ["Scene"]
    (whole,) = near_focus_far(depth, [], None)
    assert bool(whole.mask(depth).all())
    assert near_focus_far(torch.full((4, 4), math.nan), [], 1.0) == ()
