"""What a plan leaves out of rendering, and what it may not touch."""

from __future__ import annotations

import pytest

from edofsim.plan import EFFECTS, Simulation, simpler_recipe
from edofsim.plan.simulation import disperses
from edofsim.plan.thumbnail import sketch
from edofsim.recipe import load_scene


def test_nothing_left_out_is_the_recipe_itself():
    recipe = load_scene("stilllife").recipe
    assert simpler_recipe(recipe, Simulation()) is recipe


def test_what_is_left_out_of_rendering_is_out_of_the_recipe():
    recipe = load_scene("stilllife").recipe
    bare = simpler_recipe(
        recipe, Simulation(hidden_pass=False, bounces=2, samples=8, margin=16, glass_dispersion=False)
    )
    assert not bare.render.hidden and bare.render.max_depth == 2 and bare.render.samples == 8
    assert bare.frame.margin_px == 16 and not disperses(bare)


def test_a_plan_never_renders_more_than_the_recipe_says():
    recipe = load_scene("wall").recipe
    same = simpler_recipe(recipe, Simulation(bounces=9, samples=9999, margin=999))
    assert same.render == recipe.render and same.frame == recipe.frame


@pytest.mark.parametrize(("scene", "glass"), [("stilllife", True), ("desk", False), ("wall", False)])
def test_hero_wavelengths_are_for_dispersive_glass_alone(scene: str, glass: bool):
    recipe = load_scene(scene).recipe
    assert bool(disperses(recipe)) is glass
    (hero,) = [effect for effect in EFFECTS if effect.name == "hero wavelengths"]

    class Facts:
        pass

    facts = Facts()
    facts.recipe = recipe
    assert (hero.absent(facts) == "") is glass


def test_a_sketch_has_every_pixel_and_few_samples():
    recipe = load_scene("desk").recipe
    small = sketch(recipe)
    assert small.frame == recipe.frame and small.render.samples < recipe.render.samples / 8
