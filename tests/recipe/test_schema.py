"""Editors check the shipped recipes against schemas that say what the models say."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from pydantic import create_model

from edofsim.cli import invoke
from edofsim.recipe import shipped_folder
from edofsim.recipe.described import descriptions
from edofsim.recipe.kinds import OBJECTS
from edofsim.recipe.schema import json_schema, model_of

ROOT = shipped_folder("scenes")
RECIPES = [
    *((path, "scene", "./schema/scene.json") for path in sorted(ROOT.glob("*.toml"))),
    *((path, "scene", "../schema/scene.json") for path in sorted((ROOT / "families").glob("*.toml"))),
    *((path, "camera", "../schema/camera.json") for path in sorted((ROOT / "cameras").glob("*.toml"))),
    *((path, "dataset", "../schema/dataset.json") for path in sorted((ROOT / "benchmarks").glob("*.toml"))),
    *(
        (path, "train", "../scenes/schema/train.json")
        for path in sorted(shipped_folder("train").glob("*.toml"))
    ),
]


@pytest.mark.parametrize("kind", ["scene", "camera", "train", "dataset"])
def test_the_shipped_schema_is_that_of_the_models(kind: str):
    """If this fails: `edofsim schema KIND --out scenes/schema/KIND.json`."""
    stored = json.loads((ROOT / "schema" / f"{kind}.json").read_text())
    assert stored == json_schema(model_of(kind), f"edofsim {kind} recipe")


@pytest.mark.parametrize("kind", ["scene", "camera", "train", "dataset"])
def test_every_key_says_what_it_means(kind: str):
    """If this fails: write the meaning, with its unit, as a text below the field."""
    schema = json_schema(model_of(kind), kind)
    tables = {kind: schema, **schema["$defs"]}
    silent = [
        f"{name}.{key}"
        for name, table in tables.items()
        for key, entry in table.get("properties", {}).items()
        if not entry.get("description", "").strip()
    ]
    assert not silent


def test_a_key_means_what_stands_below_its_field():
    """Inherited, overridden and of a kind; a class that is made at run time has no source to read."""
    found = descriptions(model_of("scene").model_fields["frame"].annotation)
    assert found["width_px"] == "width of the frame, pixels"
    panel = descriptions(OBJECTS["panel"])
    assert panel["depth_m"].endswith("along the axis, m") and "centre" in panel["anchor"]
    assert panel["kind"] == "chooses this kind: a flat rectangle: a poster, a card, a photograph"
    assert descriptions(create_model("Made", size_mm=(float, 1.0))) == {}


@pytest.mark.parametrize("path, kind, schema", RECIPES, ids=lambda value: getattr(value, "stem", None))
def test_each_shipped_recipe_points_to_its_schema(path: Path, kind: str, schema: str):
    assert path.read_text().splitlines()[0] == f"#:schema {schema}"
    assert (path.parent / schema).resolve() == (ROOT / "schema" / f"{kind}.json").resolve()


def test_the_command_prints_valid_json(capfd: pytest.CaptureFixture[str]):
    invoke(["schema", "camera"])
    assert json.loads(capfd.readouterr().out) == json_schema(model_of("camera"), "edofsim camera recipe")
