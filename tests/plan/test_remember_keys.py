"""Estimates are kept by all that they depend on: what changes any of it changes the key."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from edofsim.core import sources
from edofsim.optics import Camera
from edofsim.optics.lenses.base import LENSES
from edofsim.plan import all_effects, facts_of, remember
from edofsim.recipe.camera import Sensor
from edofsim.recipe.kinds import MASKS

from .test_plan_photo import CAMERA, SLANTED, scene


def key_of(camera: Camera = CAMERA) -> str:
    return remember._key(facts_of(scene(SLANTED), camera), all_effects(), {}, None)


def test_the_same_camera_has_the_same_key():
    assert key_of() == key_of(Camera.from_recipe(CAMERA.recipe))


@pytest.mark.parametrize("registry", [LENSES, MASKS], ids=["lens", "mask"])
def test_the_code_of_another_package_counts(registry: object, monkeypatch: pytest.MonkeyPatch):
    before = key_of()
    ours = type(registry).code_of

    def changed(self: object, name: str) -> str:
        return "another line" if self is registry else ours(self, name)

    monkeypatch.setattr(type(registry), "code_of", changed)
    assert key_of() != before


def test_a_glass_that_bends_otherwise_counts():
    other = replace(CAMERA, mask_material=replace(CAMERA.mask_material, sellmeier=(), cauchy=(1.7, 0.0, 0.0)))
    assert key_of(other) != key_of()


def test_a_relief_counts_by_its_values():
    height_map = torch.zeros(32, 32, dtype=torch.float64)
    found = {key_of(CAMERA.with_height(height_map)), key_of(CAMERA.with_height(height_map + 1e-9)), key_of()}
    assert len(found) == 3


def test_a_response_counts_by_what_its_file_holds(tmp_path: Path):
    def with_peak(nm: int) -> str:
        rows = [f"{at},{value},{value},{value}" for at, value in ((400, 0), (nm, 1), (740, 0))]
        (tmp_path / "own.csv").write_text("\n".join(["wavelength_nm,r,g,b", *rows]))
        recipe = CAMERA.recipe.model_copy(update={"sensor": Sensor(response="own.csv")})
        return key_of(Camera.from_recipe(recipe, tmp_path))

    assert with_peak(500) != with_peak(600)


@pytest.mark.parametrize("room", ["capture", "optics", "plan", "render"])
def test_our_own_code_counts(room: str, monkeypatch: pytest.MonkeyPatch):
    before, inner = key_of(), sources.code_of

    def changed(folder: Path) -> str:
        return "another line" if folder.name == room else inner(folder)

    monkeypatch.setattr(sources, "code_of", changed)
    assert key_of() != before
