"""Whatever a plan decides, `photograph` takes it: a picture with depths, its hidden surfaces guessed."""

from __future__ import annotations

import numpy as np
import pytest

import edofsim


@pytest.fixture(scope="module")
def slope() -> edofsim.View:
    """Noise on a slope from 0.6 m to 3 m: depth edges of less than a dioptre, and fragments guessed there."""
    light = np.random.default_rng(0).random((24, 32, 3))
    return edofsim.View.from_image(light, np.linspace(0.6, 3.0, 32) * np.ones((24, 1)))


@pytest.mark.parametrize("without", [("occlusion",), ("hidden surfaces",), ("sub-apertures",), ()])
def test_a_plan_asks_for_sub_apertures_only_where_they_are_composited(
    slope: edofsim.View, without: tuple[str, ...]
):
    camera = edofsim.camera("paper-learned", window=16)
    plan = edofsim.plan_for(slope, camera, accuracy="full", without=without)
    assert plan.fidelity.occlusion == "hidden" or plan.fidelity.sub_apertures == 1
    assert edofsim.photograph(slope, camera, plan).image.isfinite().all()
