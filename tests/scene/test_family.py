"""Families: distributions in a recipe, deterministic members."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from edofsim.errors import InputError
from edofsim.recipe.family import Vary
from edofsim.recipe.scene import SceneRecipe
from edofsim.scene import build_scene
from edofsim.scene.family import draw, member, members

BASE = {
    "name": "small",
    "lights": [{"kind": "environment"}, {"kind": "bulb", "name": "bulb", "position_mm": [0, 0, 900]}],
    "objects": [
        {"kind": "sphere", "name": "ball", "radius_mm": 5, "depth_m": 1.0},
        {"kind": "panel", "name": "card", "width_mm": 10, "height_mm": 10, "depth_m": 2.0,
         "surface": {"kind": "matt", "texture": {"kind": "photo", "name": "coffee"}}},
    ],
}  # fmt: skip


def family(*vary: dict) -> SceneRecipe:
    return SceneRecipe.model_validate({**BASE, "family": {"vary": list(vary)}})


DEPTH = {"key": "objects.ball.depth_m", "inverse_uniform": [0.5, 2.0]}
PHOTO = {"key": "objects.card.surface.texture.name", "choice": ["coffee", "chelsea", "astronaut"]}
HERE = {"key": "objects.card", "present": 0.5}


def test_the_same_seed_gives_the_same_scene_and_others_give_others():
    recipe = family(DEPTH, PHOTO)
    assert member(recipe, 7) == member(recipe, 7)
    depths = {member(recipe, seed).objects[0].depth_m for seed in range(20)}
    assert len(depths) == 20


def test_a_member_is_a_recipe_of_its_own_that_can_be_built():
    one = member(family(DEPTH, PHOTO), 3)
    assert one.family is None and one.seed == 3 and one.name == "small-3"
    ball = build_scene(one, Path(".")).objects[0].mesh.vertices
    assert ball[:, 2].mean() == pytest.approx(one.objects[0].depth_m, abs=1e-4)


def test_a_distribution_at_the_end_leaves_the_others_values():
    short, long = family(DEPTH), family(DEPTH, PHOTO)
    assert [m.objects[0].depth_m for m in members(short, 5)] == [
        m.objects[0].depth_m for m in members(long, 5)
    ]


def test_inverse_uniform_is_uniform_in_dioptres():
    """1/z uniform in [0.5, 2]: mean 1.25, variance 1.5^2 / 12 (closed form), within 5 standard errors."""
    rng = np.random.default_rng(0)
    inverse = np.array([1 / draw(Vary(key="k", inverse_uniform=(0.5, 2.0)), rng) for _ in range(4000)])
    sigma = 1.5 / np.sqrt(12)
    assert inverse.mean() == pytest.approx(1.25, abs=5 * sigma / np.sqrt(4000))
    assert inverse.min() >= 0.5 and inverse.max() <= 2.0


@pytest.mark.parametrize(
    ("given", "low", "high"),
    [({"uniform": (1, 3)}, 1, 3), ({"log_uniform": (0.1, 10)}, 0.1, 10), ({"integer": (2, 4)}, 2, 4)],
)
def test_draws_stay_in_their_range(given: dict, low: float, high: float):
    rng = np.random.default_rng(1)
    values = [draw(Vary(key="k", **given), rng) for _ in range(300)]
    assert low <= min(values) < max(values) <= high
    if "integer" in given:
        assert set(values) == {2, 3, 4}


def test_things_may_be_missing():
    counts = [len(m.objects) for m in members(family(HERE), 60)]
    assert set(counts) == {1, 2} and 15 < counts.count(1) < 45


def test_lights_vary_by_name_and_by_number():
    recipe = family(
        {"key": "lights.bulb.radiance", "uniform": [1, 2]}, {"key": "lights.0.radiance", "uniform": [3, 4]}
    )
    one = member(recipe, 0)
    assert 3 <= one.lights[0].radiance <= 4 and 1 <= one.lights[1].radiance <= 2


@pytest.mark.parametrize(
    ("vary", "words"),
    [
        ({"key": "objects.bal.depth_m", "uniform": [1, 2]}, ("'bal'", "did you mean 'ball'")),
        ({"key": "objects.ball.depht_m", "uniform": [1, 2]}, ("depht_m", "did you mean 'depth_m'")),
        ({"key": "objects.9.depth_m", "uniform": [1, 2]}, ("'9'", "'ball'")),
        ({"key": "frame", "present": 0.5}, ("only objects and lights",)),
        ({"key": "objects.ball.radius_mm", "uniform": [-2, -1]}, ("radius_mm", "greater than 0")),
    ],
)
def test_keys_that_lead_nowhere_and_values_that_cannot_be_are_refused(vary: dict, words: tuple[str, ...]):
    with pytest.raises(InputError) as caught:
        member(family(vary), 0)
    assert all(word in str(caught.value) for word in words), str(caught.value)


@pytest.mark.parametrize("given", [{}, {"uniform": (1, 2), "integer": (1, 2)}, {"uniform": (2, 1)}])
def test_a_distribution_is_exactly_one(given: dict):
    with pytest.raises(ValueError, match="exactly one|must not be above"):
        Vary(key="k", **given)


def test_a_recipe_without_a_family_has_no_members():
    with pytest.raises(InputError, match="no \\[family\\]"):
        member(SceneRecipe.model_validate(BASE), 0)
