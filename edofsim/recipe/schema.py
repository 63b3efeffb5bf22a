"""JSON Schemas of the recipes, for editors that complete and check TOML."""

from __future__ import annotations

import json
from pathlib import Path

from pydantic import BaseModel

from ..core.files import write_text
from ..core.json_values import Json
from .camera import CameraRecipe
from .dataset import DatasetRecipe
from .scene import SceneRecipe
from .train import TrainRecipe

DIALECT = "https://json-schema.org/draft/2020-12/schema"


def json_schema(model: type[BaseModel], title: str) -> Json:
    """JSON Schema (draft 2020-12) of a recipe model."""
    return {"$schema": DIALECT, **model.model_json_schema(by_alias=True), "title": title}


def write_schema(model: type[BaseModel], title: str, path: Path) -> Path:
    """The schema as a file, with a stable order of keys. Returns the path."""
    return write_text(path, json.dumps(json_schema(model, title), indent=1, sort_keys=True) + "\n")


def model_of(kind: str) -> type[BaseModel]:
    """The model of a `scene`, `camera`, `train` or `dataset` recipe."""

    models: dict[str, type[BaseModel]] = {"scene": SceneRecipe, "camera": CameraRecipe}
    return (models | {"train": TrainRecipe, "dataset": DatasetRecipe})[kind]
