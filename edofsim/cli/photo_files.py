"""Photos that are there already: the same command goes on from them."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from ..core.files import write_text
from ..core.sources import code_of_rooms
from .many import OfScene

if TYPE_CHECKING:
    from ..recipe import CameraRecipe, Loaded, SceneRecipe

ABOUT = "photo.json"
ROOMS = ("core", "recipe", "scene", "render", "optics", "capture", "reference", "plan", "restore")
"""Whose code decides a photo."""


def photo_key(
    scene: Loaded[SceneRecipe],
    camera_recipe: Loaded[CameraRecipe],
    wanted: str | None,
    options: Mapping[str, object],
) -> str:
    """SHA-256 of everything that decides a photo: both recipes, the files that they name, the options, the
    code."""
    from ..render.keys import named_files, view_key

    camera = camera_recipe.recipe.model_dump(mode="json")
    content = {
        "view": view_key(scene.recipe, scene.base),
        "camera": [camera, named_files(camera, camera_recipe.base)],
        "fidelity": wanted if wanted is None or not Path(wanted).is_file() else _digest(Path(wanted)),
        "options": options,
        "code": code_of_rooms(*ROOMS),
    }
    return hashlib.sha256(json.dumps(content, sort_keys=True, default=repr).encode()).hexdigest()


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def kept_photo(folder: Path, key: str) -> OfScene | None:
    """The photo that is in a folder under this key, with all its files; None where there is none."""
    try:
        about = json.loads((folder / ABOUT).read_text(encoding="utf-8"))
        if about["key"] != key:
            return None
        outputs = {name: folder / file for name, (file, _) in about["outputs"].items()}
        if any(outputs[name].stat().st_size != size for name, (_, size) in about["outputs"].items()):
            return None
        lines = [f"{about['scene']}: the photo is there already ({folder / ABOUT})", *about["lines"]]
        return OfScene(about["scene"], lines, about["figures"], outputs, about["record"])
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None


def keep_photo(folder: Path, key: str, found: OfScene) -> None:
    """Write down what a photo came to, after all its files. Raises what `core.files.whole` raises."""
    outputs = {name: (path.name, path.stat().st_size) for name, path in found.outputs.items()}
    about = {
        "key": key,
        "scene": found.scene,
        "lines": [line for line in found.printed if isinstance(line, str)],
        "figures": dict(found.figures),
        "outputs": outputs,
        "record": dict(found.record),
    }
    write_text(folder / ABOUT, json.dumps(about, indent=1, default=repr))
