"""Editors check the shipped recipes against schemas that say what the models say."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from edofsim.recipe import shipped_folder
from edofsim.recipe.schema import json_schema, model_of

ROOT = shipped_folder("scenes")
RECIPES = [
    *((path, "scene", "./schema/scene.json") for path in sorted(ROOT.glob("*.toml"))),
    *((path, "scene", "../schema/scene.json") for path in sorted((ROOT / "families").glob("*.toml"))),
    *((path, "camera", "../schema/camera.json") for path in sorted((ROOT / "cameras").glob("*.toml"))),
    *(
        (path, "train", "../scenes/schema/train.json")
        for path in sorted(shipped_folder("train").glob("*.toml"))
    ),
]


@pytest.mark.parametrize("kind", ["scene", "camera", "train"])
def test_the_shipped_schema_is_that_of_the_models(kind: str):
    """If this fails: `edofsim schema KIND --out scenes/schema/KIND.json`."""
    stored = json.loads((ROOT / "schema" / f"{kind}.json").read_text())
    assert stored == json_schema(model_of(kind), f"edofsim {kind} recipe")


@pytest.mark.parametrize("path, kind, schema", RECIPES, ids=lambda value: getattr(value, "stem", None))
def test_each_shipped_recipe_points_to_its_schema(path: Path, kind: str, schema: str):
    assert path.read_text().splitlines()[0] == f"#:schema {schema}"
    assert (path.parent / schema).resolve() == (ROOT / "schema" / f"{kind}.json").resolve()


def test_the_command_prints_valid_json():
    done = subprocess.run(
        [sys.executable, "-m", "edofsim", "schema", "camera"], capture_output=True, text=True, check=True
    )
    assert json.loads(done.stdout) == json_schema(model_of("camera"), "edofsim camera recipe")
