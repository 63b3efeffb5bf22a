"""What a plan leaves out of rendering, and what it may not touch."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
import torch

from edofsim.capture.fidelity import disperses
from edofsim.plan import EFFECTS, Fidelity, simpler_recipe
from edofsim.plan.scene import _in_photo, preview_of, thumbnail
from edofsim.recipe import load_scene


def test_nothing_left_out_is_the_recipe_itself():
    recipe = load_scene("stilllife").recipe
    assert simpler_recipe(recipe, Fidelity()) is recipe


def test_what_is_left_out_of_rendering_is_out_of_the_recipe():
    recipe = load_scene("stilllife").recipe
    bare = simpler_recipe(
        recipe, Fidelity(hidden_surfaces=False, bounces=2, samples=8, margin_px=16, scene_dispersion=False)
    )
    assert not bare.render.hidden and bare.render.max_depth == 2 and bare.render.samples == 8
    assert bare.frame.margin_px == 16 and not disperses(bare)


def test_a_plan_never_renders_more_than_the_recipe_says():
    recipe = load_scene("wall").recipe
    same = simpler_recipe(recipe, Fidelity(bounces=9, samples=9999, margin_px=999))
    assert same.render == recipe.render and same.frame == recipe.frame


@pytest.mark.parametrize(("scene", "glass"), [("stilllife", True), ("desk", False), ("wall", False)])
def test_hero_wavelengths_are_for_dispersive_glass_alone(scene: str, glass: bool):
    recipe = load_scene(scene).recipe
    assert bool(disperses(recipe)) is glass
    hero = EFFECTS["dispersion of scene glass"]

    class Facts:
        pass

    facts = Facts()
    facts.recipe = facts.scene = recipe
    assert (hero.absent(facts) == "") is glass


def test_a_preview_has_every_pixel_and_few_samples():
    recipe = load_scene("desk").recipe
    small = preview_of(recipe)
    assert small.frame == recipe.frame and small.render.samples < recipe.render.samples / 8


def test_noise_of_a_thumbnail_averages_in_the_photo_and_light_does_not():
    """Light 0.05 everywhere and independent noise 0.2 a pixel: a PSF that leaves 0.1 of noise, and four
    times the samples, leave 0.2 * 0.1 / 2 of it."""
    recipe = load_scene("desk").recipe
    small = thumbnail(recipe)
    small = small.model_copy(update={"render": small.render.model_copy(update={"samples": 16})})
    more = recipe.model_copy(update={"render": recipe.render.model_copy(update={"samples": 64})})
    noise = torch.randn(3, 240, 320, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    facts = SimpleNamespace(scene=more, averaging=(0.1, 0.3, 1.0))
    found = _in_photo(0.05 + 0.2 * noise, facts, small)
    for error, kept in zip(found, facts.averaging, strict=True):
        assert error == pytest.approx((0.05**2 + (0.2 * kept / 2) ** 2) ** 0.5, rel=0.03)
