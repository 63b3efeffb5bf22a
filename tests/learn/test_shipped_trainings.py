"""The training recipes that ship: what they train on; each has a checkpoint or says that it has none."""

from __future__ import annotations

import pytest

from edofsim.recipe.load import load_train, shipped, shipped_folder

RECIPES = shipped(shipped_folder("train"))


@pytest.mark.parametrize("name", sorted(RECIPES))
def test_scenes_that_are_trained_on_are_of_the_families_for_training(name: str) -> None:
    """Shipped scenes and members of their families are for validation and tests."""
    families = shipped(shipped_folder("scenes") / "families").values()
    loaded = load_train(RECIPES[name])
    for source in loaded.recipe.data.sources:
        if source.kind == "views":
            paths = {(loaded.base / scene).resolve() for scene in source.scenes}
            assert paths <= {path.resolve() for path in families}


@pytest.mark.parametrize("name", sorted(RECIPES))
def test_a_recipe_has_a_checkpoint_or_says_first_that_it_has_none(name: str) -> None:
    found = list((shipped_folder("train") / "checkpoints").rglob(f"{name}.safetensors"))
    says = RECIPES[name].read_text().splitlines()[1].startswith("# No checkpoint that this made ships")
    assert bool(found) != says
