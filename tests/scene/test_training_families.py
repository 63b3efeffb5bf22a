"""The families that are trained on: they build, differ from one another, and share no picture with tests."""

from __future__ import annotations

import re
from itertools import combinations

import numpy as np
import pytest

from edofsim.recipe.load import load_scene, shipped, shipped_folder
from edofsim.scene import build_scene
from edofsim.scene.family import member, members

FAMILIES = shipped(shipped_folder("scenes") / "families")


def _photos(text: str) -> set[str]:
    return set(re.findall(r'kind = "photo", name = "(\w+)"', text))


def test_eight_kinds_at_least_that_name_different_things() -> None:
    """No two families hold the same kinds of objects in the same numbers."""
    assert len(FAMILIES) >= 8
    held = {
        name: sorted(thing.kind for thing in load_scene(path).recipe.objects)
        for name, path in FAMILIES.items()
    }
    assert all(held[a] != held[b] for a, b in combinations(held, 2))


@pytest.mark.parametrize("name", sorted(FAMILIES))
def test_members_can_be_drawn_and_differ(name: str) -> None:
    loaded = load_scene(FAMILIES[name])
    assert loaded.recipe.name == name and len(loaded.recipe.purpose.split()) > 10
    drawn = members(loaded.recipe, 40)
    assert len({recipe.model_dump_json(exclude={"name", "seed"}) for recipe in drawn}) == 40


@pytest.mark.parametrize("name", sorted(FAMILIES))
def test_a_member_is_deep(name: str) -> None:
    """Things that touch the frame lie two thirds of a dioptre apart and more: the paper's range is two."""
    loaded = load_scene(FAMILIES[name])
    for seed in (1, 2):
        model = build_scene(member(loaded.recipe, seed), loaded.base)
        half = 128 * loaded.recipe.frame.pixel_angle
        seen = []
        for thing in model.objects:
            x, y, z = thing.mesh.vertices.T.astype(float)
            inside = (z > 0.4) & (np.abs(x) < half * z) & (np.abs(y) < half * z)
            seen += [*(1 / z[inside])]
            if not inside.any() and z.min() > 0.4:  # larger than the frame
                seen.append(1 / float(np.median(z)))
        assert np.ptp(seen) > 2 / 3, (name, seed)


def test_no_picture_of_theirs_is_in_a_shipped_scene() -> None:
    tests = {
        photo for path in shipped(shipped_folder("scenes")).values() for photo in _photos(path.read_text())
    }
    for name, path in FAMILIES.items():
        assert not _photos(path.read_text()) & tests, name
